-- servo-sniffer for Wireshark: requests and answers on robot-servo buses, with their registers.
-- Written by `sniffer wireshark install`.
--
-- The engine is written by hand (sniffer/wireshark/engine); the tables in it are generated from the
-- grammars, commands and register tables that the decoder reads (sniffer/wireshark/tables.py).
-- It reads what `sniffer` writes as pcapng: link type RTAC serial, a packet a frame or a gap, told
-- by the footer of its head; any other RTAC capture is left to Wireshark's own dissector.
--
-- Three things shape it. Wireshark goes over a capture twice, first in order and often without a
-- tree: then frames are paired and what servos told of themselves is kept, by frame number; no
-- field of another dissector is asked, for those are empty then. Whatever is shown is made only if
-- there is a tree. And it must run in Lua 5.1 (Wireshark 3) up to 5.4: no integer operators.

local P = Proto("servo", "Robot servo bus")

-- @TABLES@

---------------------------------------------------------------------------------- numbers and bits

local floor, byte, sub, format = math.floor, string.byte, string.sub, string.format

local bxor = (bit and bit.bxor) or (bit32 and bit32.bxor)
  or (load or loadstring)("return function(a, b) return a ~ b end")()

local function has(number, mask)  -- one bit of a number, by its mask
  return floor(number / mask) % 2 == 1
end

local function bits_of(number, shift, mask)  -- `mask` is one less than a power of two
  return floor(number / 2 ^ shift) % (mask + 1)
end

local FOLDS = {
  sum = function(raw, first, last)
    local s = 0
    for i = first, last do s = s + byte(raw, i) end
    return 255 - s % 256
  end,
  xor8 = function(raw, first, last)
    local s = 0
    for i = first, last do s = bxor(s, byte(raw, i)) end
    return s
  end,
}
FOLDS.xor7 = function(raw, first, last) return FOLDS.xor8(raw, first, last) % 128 end

local READS = {  -- a number at `i` (the first byte is 1), by the type names of the tables
  u8 = function(raw, i) return byte(raw, i) end,
  i8 = function(raw, i) local v = byte(raw, i); return v < 128 and v or v - 256 end,
  u16le = function(raw, i) local a, b = byte(raw, i, i + 1); return a + b * 256 end,
  u16be = function(raw, i) local a, b = byte(raw, i, i + 1); return b + a * 256 end,
}
READS.i16le = function(raw, i) local v = READS.u16le(raw, i); return v < 32768 and v or v - 65536 end
READS.i16be = function(raw, i) local v = READS.u16be(raw, i); return v < 32768 and v or v - 65536 end
READS.u32 = function(raw, i) return READS.u16le(raw, i) + READS.u16le(raw, i + 2) * 65536 end
READS.u32be = function(raw, i) return READS.u16be(raw, i) * 65536 + READS.u16be(raw, i + 2) end

-- Written out: from Lua 5.3 on 2 ^ 32 is a float, and what it is taken from would be shown as -5.0.
local TWO_31, TWO_32 = 2147483648, 4294967296
READS.i32 = function(raw, i) local v = READS.u32(raw, i); return v < TWO_31 and v or v - TWO_32 end
READS.i32be = function(raw, i)
  local v = READS.u32be(raw, i)
  return v < TWO_31 and v or v - TWO_32
end
-- Exact where Lua has integers (5.3); before that up to 53 bits, as far as its numbers go.
READS.i64 = function(raw, i) return READS.u32(raw, i) + READS.i32(raw, i + 4) * TWO_32 end

local function digits(raw)  -- all of them: old Lua writes numbers from 1e14 on in short
  return math.type and tostring(raw) or format("%.0f", raw)
end

-------------------------------------------------------------------------------------------- fields

local F = P.fields
local KINDS = {[0] = "request", [1] = "response", [2] = "no frame"}
local GOOD = {[0] = "bad", [1] = "good", [2] = "none"}
F.protocol = ProtoField.string("servo.protocol", "Protocol")
F.kind = ProtoField.uint8("servo.kind", "Kind", base.DEC, KINDS)
F.id = ProtoField.uint8("servo.id", "Servo")
F.op = ProtoField.string("servo.op", "Command")
F.status = ProtoField.uint16("servo.status", "Status", base.HEX)
F.status_name = ProtoField.string("servo.status.name", "Reports")
F.addr = ProtoField.uint16("servo.addr", "Address")
F.count = ProtoField.uint16("servo.count", "Bytes asked for")
F.data = ProtoField.bytes("servo.data", "Data")
F.target = ProtoField.uint8("servo.target", "Of servo")
F.checksum = ProtoField.uint8("servo.checksum", "Checksum", base.HEX)
F.sum_status = ProtoField.uint8("servo.checksum.status", "Checksum status", base.DEC, GOOD)
F.sum_bad = ProtoField.bool("servo.checksum.bad", "Checksum does not hold")
F.response_in = ProtoField.framenum("servo.response_in", "Response in", base.NONE,
  frametype.RESPONSE)
F.response_to = ProtoField.framenum("servo.response_to", "Response to", base.NONE,
  frametype.REQUEST)
F.refused = ProtoField.bool("servo.refused", "Refused by the servo")
F.outcome = ProtoField.string("servo.outcome", "Outcome")
F.rtt = ProtoField.double("servo.rtt", "Response time [s]")
F.rtt_unsure = ProtoField.double("servo.rtt.uncertainty", "Uncertainty of the response time [s]")
F.register = ProtoField.string("servo.register", "Register")
F.raw = ProtoField.int64("servo.raw", "Raw value")
F.text = ProtoField.string("servo.text", "Text")
F.model = ProtoField.string("servo.model", "Read by the table of")

local E_SUM = ProtoExpert.new("servo.expert.checksum", "The checksum does not hold",
  expert.group.CHECKSUM, expert.severity.ERROR)
local E_STATUS = ProtoExpert.new("servo.expert.status", "The servo reports an error",
  expert.group.RESPONSE_CODE, expert.severity.WARN)
local E_GAP = ProtoExpert.new("servo.expert.no_frame", "Bytes that no frame claims",
  expert.group.MALFORMED, expert.severity.WARN)
local E_UNASKED = ProtoExpert.new("servo.expert.unsolicited", "An answer that nobody asked for",
  expert.group.SEQUENCE, expert.severity.WARN)
P.experts = {E_SUM, E_STATUS, E_GAP, E_UNASKED}

local function field_of(name)  -- one for all registers of a name, whatever their protocol
  local key = "reg_" .. name
  F[key] = F[key] or ProtoField.double("servo.reg." .. name, (name:gsub("_", " ")))
  return F[key]
end

for _, spec in pairs(PROTOCOLS) do
  for _, model in ipairs(spec.models) do
    model.owner = {}
    for _, reg in ipairs(model.registers) do
      reg.field = field_of(reg.name)
      reg.read = READS[reg.type]
      for k = 0, (reg.address and reg.width or 0) - 1 do model.owner[reg.address + k] = reg end
    end
  end
  if #spec.models > 1 then
    local choices = {{0, "as the bus tells", 0}}
    for m, model in ipairs(spec.models) do choices[#choices + 1] = {m, model.name, m} end
    spec.chosen = "model_" .. spec.name
    P.prefs[spec.chosen] = Pref.enum("Model of " .. spec.name .. " servos", 0,
      "The register table by which their values are read", choices)
  end
end

------------------------------------------------------------------------------- what servos told

-- Kept by bus: for each servo the model its number or name tells and the registers that select a
-- scale. Tables are never changed, only replaced, so that a frame can keep the one it was read by.

local NOTHING = {}

local function told_of(state, id) return state.servos[id] or NOTHING end

local function with(state, id, key, value)
  local servos, one = {}, {}
  for k, v in pairs(state.servos) do servos[k] = v end
  for k, v in pairs(told_of(state, id)) do one[k] = v end
  one[key] = value
  servos[id] = one
  return {servos = servos, low = state.low, high = state.high}
end

local function model_of(spec, state, id)  -- its number; the first is assumed
  local chosen = spec.chosen and P.prefs[spec.chosen] or 0
  return chosen > 0 and chosen or told_of(state, id).model or 1
end

local function value_of(state, id, reg, raw)  -- nil: none in units
  if reg.special and reg.special[raw] then return nil end
  if reg.scales then
    local mode = told_of(state, id)[reg.by]
    if not mode then return raw * reg.scale end
    local scale = reg.scales[mode]
    return scale and raw * scale
  end
  if reg.sign_bit then
    local half = 2 ^ reg.sign_bit
    local size = raw % half
    if not has(raw, half) then size = -size end
    return (size == 0 and 0 or size) * reg.scale
  end
  return raw * reg.scale
end

local function name_of(reg, raw)  -- what a number means, in words
  if reg.special and reg.special[raw] then return reg.special[raw] end
  if reg.bits then
    local out = {}
    for k = 0, 31 do
      if has(raw % 2 ^ 32, 2 ^ k) then out[#out + 1] = reg.bits[k] or ("bit" .. k) end
    end
    return table.concat(out, " ")
  end
  return reg.values and (reg.values[raw] or "unknown")
end

-- A value in a frame: {servo, register, at (from 0), width, raw, part, loose}; `part` where a packet
-- has but some bytes of a register, which is no value, `loose` where a register that selects a scale
-- stands among bytes that its table has no name for: then it may be none.
local function span(spec, state, out, raw, servo, address, at, length)
  local model = spec.models[model_of(spec, state, servo)]
  local a, stop = address, address + length
  while a < stop do
    local reg = model.owner[a]
    if not reg then a = a + 1 else
      local last = math.min(reg.address + reg.width, stop)
      local here = at + a - address
      if a == reg.address and last == reg.address + reg.width then
        out[#out + 1] = {servo, reg, here, reg.width, reg.read(raw, here + 1)}
        if reg.selects then
          for b = address, stop - 1 do
            if not model.owner[b] then out[#out][7] = true end
          end
        end
      else
        out[#out + 1] = {servo, reg, here, 1, byte(raw, here + 1), true}
      end
      a = last
    end
  end
end

-- What a frame tells that changes how later ones are read.
local function heard(spec, state, frame, values)
  for _, v in ipairs(values) do
    local servo, reg, raw = v[1], v[2], v[5]
    if not v[6] then
      if frame.kind == 1 and spec.numbers and reg.identifies and spec.numbers[raw] then
        if told_of(state, servo).model ~= spec.numbers[raw] then
          state = with(state, servo, "model", spec.numbers[raw])
        end
      elseif reg.selects and told_of(state, servo)[reg.name] ~= raw
        and (not v[7] or (frame.kind == 1 and told_of(state, servo).model)) then
        state = with(state, servo, reg.name, raw)
        if spec.everyone[servo] then
          for id in pairs(state.servos) do state = with(state, id, reg.name, raw) end
        end
      elseif reg.scales then
        -- a position far outside the stroke: the scale it was read by cannot be
        local mode = told_of(state, servo)[reg.by]
        if mode and reg.limits and reg.limits[mode] and raw > reg.limits[mode] then
          state = with(state, servo, reg.by, nil)
        end
      elseif frame.kind == 0 and reg.effect == "servo_id" and state.servos[servo] then
        local servos = {}
        for k, one in pairs(state.servos) do servos[k] = one end
        servos[raw] = state.servos[servo]
        state = {servos = servos, low = state.low, high = state.high}
      end
    end
  end
  return state
end
