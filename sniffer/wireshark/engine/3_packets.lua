------------------------------------------------------------------------------------------- pairing

-- The rules are the decoder's: what both carry must agree, servo and token (the key); of requests
-- and answers of one key the last requests have the first answers, so that the answer of a retry is
-- the retry's. A silence, `reach` bytes or sixteen other requests close a request.

local DEPTH = 16
local seen, buses  -- by frame number; by bus

function P.init() seen, buses = {}, {} end

local function new_bus()
  return {state = {servos = {}}, offset = 0, asked = 0, open = {}, runs = {}, row = {}}
end

local function bind(request, answer, outcome)
  if answer.request and answer.request.answer == answer then answer.request.answer = nil end
  local before = request and request.answer
  if before and before ~= answer and before.outcome == "mismatched" then  -- it was none after all
    before.request, before.outcome = nil, "unsolicited"
  end
  answer.request, answer.outcome = request, outcome
  if request then request.answer = answer end
end

local function is_open(spec, q, r)
  return r.start - q.stop <= spec.reach and r.asked - q.asked < DEPTH
end

local function names(q, id) return id == q.frame.id or q.frame.alt == true or (id and q.frame.alt == id) end

local function fits(q, r)
  return names(q, r.frame.id) and (r.frame.token == nil or r.frame.token == q.frame.token)
end

local function key_of(id, token) return (id or "") .. "|" .. (token or "") end

local function enter(bus, q, key)  -- a request into the run of its key, in order
  local run = bus.runs[key]
  if not run or #run.answers > 0 then
    run = {requests = {}, answers = {}}
    bus.runs[key] = run
  end
  q.key = key
  local at = #run.requests + 1
  while at > 1 and run.requests[at - 1].number > q.number do at = at - 1 end
  table.insert(run.requests, at, q)
end

local function ask(spec, bus, q)
  local f = q.frame
  bus.open[#bus.open + 1] = q
  if #bus.open > 4 * DEPTH then
    local kept = {}
    for i = #bus.open - 2 * DEPTH, #bus.open do kept[#kept + 1] = bus.open[i] end
    bus.open = kept
  end
  if f.many then
    for key in pairs(bus.runs) do
      if key:match("|(.*)$") == f.token then bus.runs[key] = nil end
    end
  elseif not f.alt then
    enter(bus, q, key_of(f.id, f.token))
  end
end

local function answer(spec, bus, r)
  local f, token = r.frame, r.frame.token
  for _, q in ipairs(bus.open) do  -- whose id may be another's takes it from its first answer
    if not q.key and not q.frame.many and fits(q, r) and is_open(spec, q, r) then
      enter(bus, q, key_of(f.id, q.frame.token))
    end
  end
  if token == nil then
    for i = #bus.open, 1, -1 do
      local q = bus.open[i]
      if q.frame.many then break end
      if names(q, f.id) and is_open(spec, q, r) then token = q.frame.token; break end
    end
  end
  local run = token ~= nil and bus.runs[key_of(f.id, token)]
  if run then
    table.insert(run.answers, r)
    local asked, n = run.requests, 0
    while n < math.min(#asked, #run.answers)
      and is_open(spec, asked[#asked - n], run.answers[n + 1]) do n = n + 1 end
    for _, q in ipairs(asked) do
      if q.answer and q.answer.outcome == "ok" then q.answer = nil end
    end
    for i = 1, n do bind(asked[#asked - n + i], run.answers[i], "ok") end
    if r.request then return end
  end
  for i = #bus.open, 1, -1 do
    local q = bus.open[i]
    if q.frame.many and fits(q, r) and is_open(spec, q, r) then
      r.request, r.outcome = q, "ok"
      q.answer = q.answer or r
      return
    end
  end
  local last = bus.last
  if last and last.frame.asks and is_open(spec, last, r) and (last.frame.many
    or (last.row == r.row - 1 and not last.answer)) then
    bind(last, r, "mismatched")
  else
    r.outcome = "unsolicited"
  end
end

-- Where answers name nobody: of m in a row the last m requests before them have one each.
local function in_order(bus, r)
  local row = bus.row
  table.insert(row.answers, r)
  for i, q in ipairs(row) do q.answer = nil end
  for i, one in ipairs(row.answers) do
    local q = row[#row - #row.answers + i]
    one.request, one.outcome = nil, "unsolicited"
    if q and q.frame.asks then bind(q, one, "ok") end
  end
end

local function refuses(spec, r)  -- an answer by which the servo says that it did not do it
  for _, mask in ipairs(r and r.outcome == "ok" and r.frame.status and spec.refusals or {}) do
    if has(r.frame.status, mask) then return true end
  end
  return false
end

-- What an answer is only with its request, which a later answer may still change.
local function ask_of(me, raw)
  local f, q = me.frame, me.request
  f.asked = me.outcome == "ok" and q and q.frame or nil
  if f.bare and q then
    f.id = q.frame.id
    if q.frame.command and q.frame.command.nobody then f.id = byte(raw, 1) end
  end
end

local function told(spec, bus, me, raw)  -- what this frame changes for those behind it
  local f = me.frame
  if f.kind == 1 then
    local q = me.request
    ask_of(me, raw)
    if q and q.before and refuses(spec, me) then bus.state = q.before end  -- it did not become so
    if not f.asked and not f.itself then me.state = bus.state; return end
    if spec.names then bus.state = named(spec, bus.state, f) end
  end
  if spec.ops then
    bus.state = shown(bus.state, reads_of(spec, f, raw), raw)
  elseif spec.watches then
    local before = bus.state
    local values = values_in[spec.style](spec, before, f, raw)
    bus.state = heard(spec, before, f, values)
    if bus.state == before then me.values = values else me.before = before end
    if f.resets then
      for _, name in ipairs(spec.watches) do bus.state = with(bus.state, f.id, name, nil) end
    end
  end
  me.state = bus.state
end

local function learn(spec, number, kind, raw, bus_number, begins, ends)
  local bus = buses[bus_number]
  if not bus or ends < (bus.ends or ends) - spec.tail then  -- time went back: another capture
    bus = new_bus()
    buses[bus_number] = bus
  end
  local me = {number = number, begins = begins, ends = ends, bus = bus}
  seen[number] = me
  if bus.ends and begins - bus.ends > spec.tail then
    bus.open, bus.runs, bus.row, bus.last = {}, {}, {}, nil
  end
  bus.ends = ends
  me.start, me.stop = bus.offset, bus.offset + #raw
  bus.offset = me.stop
  local found = describe[spec.style](spec, raw, kind % 2)
  if kind == 2 and not found then found = describe[spec.style](spec, raw, 1) end
  local is_bad = found and found.sum and found.sum[1] ~= found.sum[2]
  if is_bad then me.bad = found.sum end
  if kind < 2 and not is_bad then
    me.frame = found
  end
  if me.frame then
    bus.rows = (bus.rows or 0) + 1
    me.row = bus.rows
    if kind == 0 then
      if me.frame.asks then bus.asked = bus.asked + 1 end
      me.asked = bus.asked
      if spec.ordered then
        if not bus.row.answers or #bus.row.answers > 0 then bus.row = {answers = {}} end
        table.insert(bus.row, me)
      elseif me.frame.asks then ask(spec, bus, me) end
      bus.last = me
    else
      me.asked = bus.asked
      if spec.ordered then
        bus.row.answers = bus.row.answers or {}
        in_order(bus, me)
      else answer(spec, bus, me) end
    end
    told(spec, bus, me, raw)
  end
  return me
end
