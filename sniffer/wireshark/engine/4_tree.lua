------------------------------------------------------------------------------------------ the tree

-- A capture without times says so of its interface: then what is between two stamps is no time.
-- Of one with times it says how far they may be late. Asked where there is a tree, and remembered
-- only once there is an answer: without a tree, and in a first pass, no field has a value.
local interface_field = Field.new("frame.interface_description")

local function clock_of(bus)
  local told = not bus.clock and interface_field()
  if told then
    local text = tostring(told)
    local _, at = text:find(WITHIN, 1, true)
    local late = at and tonumber(text:match("^[%d.]+", at + 1))
    bus.clock = {timed = not text:find(NO_TIMES, 1, true), unsure = late and late / 1e3}
  end
  return bus.clock or {timed = true}
end

local function in_micros(value) return floor(value * 1e6 + 0.5) / 1e6 end

local function show_value(state, tree, tvb, v, id, is_seen)
  local servo, reg, at, width, raw = v[1], v[2], v[3], v[4], v[5]
  local range = tvb(at, width)
  local value = nil
  if not v[6] then value = value_of(state, servo, reg, raw) end
  local item
  if value then
    item = tree:add(reg.field, range, in_micros(value))
  else
    item = tree:add(F.register, range, reg.name)
  end
  if is_seen then
    local words = not v[6] and name_of(reg, raw)
    item:append_text((value and reg.unit and " " .. reg.unit or "")
      .. (v[6] and ", a part of it" or "")
      .. " (raw " .. digits(raw) .. (words and ", " .. words or "") .. ")")
  end
  if servo and servo ~= id then item:add(F.target, range, servo) end
  if not value then item:add(F.raw, range, Int64.new(raw)) end
end

local function in_words(state, values, id)  -- for the column: what the frame says of registers
  local out = {}
  for i, v in ipairs(values) do
    if i > 6 then out[#out + 1] = "..."; break end
    local servo, reg, raw = v[1], v[2], v[5]
    local value = not v[6] and value_of(state, servo, reg, raw)
    local words = not v[6] and name_of(reg, raw)
    local said = words or (value and (format("%.6g", value) .. (reg.unit and " " .. reg.unit or "")))
    out[#out + 1] = (servo ~= id and servo and servo .. ": " or "") .. reg.name .. " "
      .. (said or format("raw %d", raw))
  end
  return table.concat(out, ", ")
end

local function show_sum(top, tvb, sum)
  if not sum then
    top:add(F.sum_status, 2):set_generated()
    return
  end
  local want, got = sum[1], sum[2]
  local item = top:add(F.checksum, tvb(tvb:len() - 1, 1))
  local bad = want ~= got
  item:append_text(bad and format(" [should be 0x%02x]", want) or " [correct]")
  item:add(F.sum_status, bad and 0 or 1):set_generated()
  if bad then
    item:add(F.sum_bad, true):set_generated()
    item:add_proto_expert_info(E_SUM)
  end
end

local function show_status(spec, top, tvb, f)
  local at = spec.status_at or 0
  local item = top:add(F.status, tvb(math.min(at, tvb:len() - 1), 1), f.status)
  if f.status == 0 then return end
  local said = spec.status[f.status]
  if spec.status_bits then
    for k = 0, 7 do
      if has(f.status, 2 ^ k) then
        item:add(F.status_name, tvb(at, 1), spec.status_bits[k] or ("bit" .. k))
      end
    end
  end
  if said then item:add(F.status_name, tvb(0, 1), said) end
  item:add_proto_expert_info(E_STATUS)
end

-- There always is a tree, also where nobody looks into it: then Wireshark throws away what is added,
-- at the price of adding it. It is asked once a packet whether any field of ours is wanted.
local own

local function is_wanted(tree)
  if not tree.referenced then return true end
  own = own or Dissector.get("servo")
  return tree:referenced(own)
end

local function is_worth_a_word(me)  -- what is told to experts, who look at no field
  local f = me.frame
  return not f or (f.status or 0) ~= 0 or (f.sum and f.sum[1] ~= f.sum[2])
    or (f.kind == 1 and me.outcome == "unsolicited")
end

local function show(spec, me, tvb, tree, values, op, address)
  local f = me.frame
  local whole = tvb()
  local top = tree:add(P, whole, spec.title)
  if not is_wanted(tree) and not is_worth_a_word(me) then return end
  top:add(F.protocol, spec.name):set_generated()
  top:add(F.kind, f and f.kind or 2):set_generated()
  if not f then
    top:add(F.data, whole)
    top:add_proto_expert_info(E_GAP)
    if me.bad then show_sum(top, tvb, me.bad) end
    return
  end
  if f.id then
    local item = top:add(F.id, f.id_at and tvb(f.id_at, f.id_width or 1) or whole, f.id)
    local model = spec.models[model_of(spec, me.state, f.id)]
    if #spec.models > 1 and #values > 0 then item:add(F.model, model.name):set_generated() end
  end
  top:add(F.op, f.op_at and tvb(f.op_at, f.op_width or 1) or whole, op)
  if f.status then show_status(spec, top, tvb, f) end
  if address then top:add(F.addr, whole, address) end
  if f.count then top:add(F.count, whole, f.count) end
  if f.text then top:add(F.text, tvb(f.at, f.width), f.text) end
  if f.data_length and f.data_length > 0 then top:add(F.data, tvb(f.data_at, f.data_length)) end
  local is_seen = tree.visible ~= false or not tree.referenced  -- texts, too, not only fields
  local all = is_seen or tree:referenced(F.register) or tree:referenced(F.raw)
    or tree:referenced(F.target)
  for _, v in ipairs(values) do
    if all or tree:referenced(v[2].field) then show_value(me.state, top, tvb, v, f.id, is_seen) end
  end
  show_sum(top, tvb, f.sum)
  if f.kind == 1 then
    top:add(F.outcome, me.outcome):set_generated()
    if me.outcome == "unsolicited" then top:add_proto_expert_info(E_UNASKED) end
  end
  if me.request then
    top:add(F.response_to, me.request.number):set_generated()
    local clock = clock_of(me.bus)
    if clock.timed then
      local took = in_micros(math.max(me.begins - me.request.ends, 0))  -- the head has no more
      local item = top:add(F.rtt, took):set_generated()
      if clock.unsure then item:add(F.rtt_unsure, clock.unsure):set_generated() end
    end
  end
  if me.answer then top:add(F.response_in, me.answer.number):set_generated() end
  if refuses(spec, me.answer) then top:add(F.refused, true):set_generated() end
end

local function dissect(spec, tvb, pinfo, tree, kind, bus_number, begins)
  local raw = tvb:raw()
  local number = pinfo.number
  local me = seen[number]
  if not me then
    me = learn(spec, number, kind, raw, bus_number, begins, pinfo.abs_ts)
  end
  local f = me.frame
  pinfo.cols.protocol = spec.name
  if not f then
    pinfo.cols.info = "no frame: " .. tvb:bytes():tohex(false, " ")
    if tree then show(spec, me, tvb, tree) end
    return
  end
  local q = me.request
  if f.kind == 1 then ask_of(me, raw) end
  local op, address = f.op, f.address
  if f.kind == 1 and q and (me.outcome == "ok" or not f.itself) then
    op, address = q.frame.op, address or q.frame.address
  end
  local values = me.values
  me.values = nil  -- of the first pass, where they were read already
  if not values then
    local is_told = f.kind == 0 or f.asked or f.itself
    values = is_told and values_in[spec.style](spec, me.state, f, raw) or {}
  end
  local who = f.id and ("servo " .. f.id) or "servos"
  if f.kind == 0 and f.id and spec.everyone[f.id] then who = "all servos" end
  pinfo.cols.src = f.kind == 0 and "controller" or who
  pinfo.cols.dst = f.kind == 0 and who or "controller"
  local said = #values > 0 and in_words(me.state, values, f.id) or f.text or ""
  if #values == 0 and f.count and address then said = format("address %d, %d bytes", address, f.count) end
  pinfo.cols.info = format("%s %s %s", f.kind == 0 and "request " or "response", op or "?", said)
  if tree then show(spec, me, tvb, tree, values, op, address) end
end

---------------------------------------------------------------------------------- which are ours

local HEAD = 12  -- bytes of the RTAC head: seconds, microseconds, event, control lines, footer

local encap = DissectorTable.get("wtap_encap")
local original = encap:get_dissector(wtap.RTAC_SERIAL)
local shim = Proto("servo_rtac", "Servo bus in RTAC serial")

function P.dissector(tvb, pinfo, tree)  -- "Decode as": nothing is known but the bytes
  return 0
end

function shim.dissector(tvb, pinfo, tree)
  local foot = tvb:len() > HEAD and tvb(10, 2):uint() or 0
  local spec = PROTOCOLS[foot % 16]
  if floor(foot / 4096) ~= 5 or not spec then return original:call(tvb, pinfo, tree) end
  if tree then original:call(tvb(0, HEAD):tvb(), pinfo, tree) end
  local begins = tvb(0, 4):uint() + tvb(4, 4):uint() * 1e-6
  local kind = pinfo.p2p_dir == 0 and 0 or pinfo.p2p_dir == 1 and 1 or 2
  dissect(spec, tvb(HEAD):tvb(), pinfo, tree, kind, foot % 4096, begins)
  return tvb:len()
end

encap:add(wtap.RTAC_SERIAL, shim)
