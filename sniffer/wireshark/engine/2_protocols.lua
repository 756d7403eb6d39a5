------------------------------------------------------------------------------ packets of one form

-- Each protocol's `describe(spec, raw, kind)` returns a frame, nil where the bytes are none:
--   id, op        the servo's, nil where the frame names none; the command's name
--   asks, many    a request that is answered, by all servos one after the other
--   token         what an answer must have in common with its request; nil in an answer: any
--   alt           the other id that may answer, true: any
--   address, status, count, sum ({right, sent})
--   itself        an answer that says itself what its values are
-- and `values(spec, state, frame, raw)` returns what it says of registers; `frame.asked` is the
-- request of an answer.

local describe, values_in = {}, {}

function describe.packets(spec, raw, kind)
  local n = #raw
  if n < spec.least or sub(raw, 1, #spec.header) ~= spec.header then return nil end
  if n ~= byte(raw, spec.size_at + 1) + spec.extra then return nil end
  local id, code = byte(raw, spec.id_at + 1), byte(raw, spec.code_at + 1)
  local params = n - spec.body_at - 1
  local f = {id = id, kind = kind, sum = {FOLDS[spec.fold](raw, spec.sum_from + 1, n - 1), byte(raw, n)}}
  f.data_at, f.data_length, f.id_at, f.op_at = spec.body_at, params, spec.id_at, spec.code_at
  if kind == 1 then
    f.op, f.status = spec.answer, code
    f.token = params
    if code > 0 and params == 0 then f.token = nil end
    return f
  end
  local cmd = spec.commands[code]
  f.op = cmd and cmd.name or format("unknown_%02x", code)
  f.asks = not spec.silent[id] and (not cmd or cmd.reply ~= "never")
  f.token = 0
  f.alt = spec.anyone[id] or nil
  if not cmd or params < cmd.least or (cmd.most and params > cmd.most) then return f end
  f.command = cmd
  local first = spec.body_at + 1
  if cmd.address then f.address = byte(raw, first + cmd.address) end
  if cmd.length then f.count = byte(raw, first + cmd.length) end
  if cmd.reads then f.token = f.count end
  if cmd.writes then
    local at = (spec.servo_id or -1) - f.address
    if at >= 0 and at < params - cmd.fixed and not f.alt then
      f.alt = byte(raw, first + cmd.fixed + at)
    end
  end
  if cmd.option and cmd.new_id and not f.alt then
    local bit_mask, new = cmd.new_id[1], cmd.new_id[2]
    if has(byte(raw, first + cmd.option), bit_mask) then f.alt = new end
  end
  f.resets = cmd.resets
  return f
end

function values_in.packets(spec, state, f, raw)
  local out, cmd = {}, f.command
  if f.kind == 1 then
    local asked = f.asked
    if asked and asked.address and asked.command and asked.command.reads then
      span(spec, state, out, raw, f.id, asked.address, f.data_at, f.data_length)
    end
  elseif cmd and cmd.writes then
    span(spec, state, out, raw, f.id, f.address, f.data_at + cmd.fixed, f.data_length - cmd.fixed)
  elseif cmd and cmd.targets and f.count then
    local at = f.data_at + cmd.fixed
    while f.count > 0 and at + 1 + f.count <= f.data_at + f.data_length do
      span(spec, state, out, raw, byte(raw, at + 1), f.address, at + 1, f.count)
      at = at + 1 + f.count
    end
  end
  return out
end

-------------------------------------------------------------------------------------------- RS30x

function describe.rs30x(spec, raw, kind)
  local n = #raw
  if n == 1 then
    local status = byte(raw, 1) ~= spec.ack and spec.nack or nil
    return {kind = 1, op = "ack", token = spec.ack_token, status = status, bare = true}
  end
  if n < spec.least then return nil end
  local id, flags, address, length, count = byte(raw, 3, 7)
  local due = spec.least + length * count
  if n ~= due and not (n == due + 1 and due == spec.least and has(flags, spec.reset)) then
    return nil
  end
  local f = {id = id, kind = kind, sum = {FOLDS[spec.fold](raw, 3, n - 1), byte(raw, n)}}
  f.data_at, f.data_length, f.id_at, f.op_at = spec.least - 1, n - spec.least, 2, spec.status_at
  if kind == 1 then
    if sub(raw, 1, 2) ~= spec.back then return nil end
    f.op, f.status, f.address, f.itself = "return", flags, address, true
    f.token = address * 256 + length
    return f
  end
  if sub(raw, 1, 2) ~= spec.header then return nil end
  local nibble, data = flags % 16, f.data_length
  local form = spec.replies[nibble]
  for _, one in ipairs(spec.flags) do
    if not f.op and has(flags, one[1]) then f.op = one[2] end
  end
  local plain = not f.op
  if plain then
    f.op = nibble > 0 and data == 0 and "read" or id == spec.long and "long_write" or "write"
  end
  local alone = id ~= spec.long and id ~= spec.all
  f.asks = nibble > 0 and alone and plain
  if form then
    local from, size = form[1], form[2]
    if form.own then from, size = address, length end
    f.token = form.ack and spec.ack_token or from * 256 + size
    if f.op == "read" and not form.ack then f.address, f.count = from, size end
  else
    f.token = -1
  end
  local carries = not plain and data > 0 and address ~= spec.command_address and id ~= spec.long
  if f.op == "write" or f.op == "long_write" or carries then f.address = address end
  if f.op == "write" or carries then f.sets = data > 0 and count == 1 end
  if f.op == "long_write" then f.sets = length >= 2 and data > 0 and data % length == 0 end
  f.block = length
  if form and form.ack then f.alt = true
  elseif f.op == "write" then
    local at = spec.servo_id - address
    if at >= 0 and at < data then f.alt = byte(raw, 8 + at) end
  elseif f.op == "factory_reset" and alone then f.alt = spec.default_id end
  return f
end

function values_in.rs30x(spec, state, f, raw)
  local out = {}
  if f.bare or (f.kind == 0 and not f.sets) then return out end
  if f.op == "long_write" and f.kind == 0 then
    for at = f.data_at, f.data_at + f.data_length - f.block, f.block do
      span(spec, state, out, raw, byte(raw, at + 1), f.address, at + 1, f.block - 1)
    end
  else
    span(spec, state, out, raw, f.id, f.address, f.data_at, f.data_length)
  end
  return out
end

---------------------------------------------------------------------------------------------- LSS

local function query_form(word)
  return (sub(word, 1, 1) == "Q" or #word == 13) and word or "Q" .. word
end

local function text_reply(spec, raw)  -- a query's word, the longest first, and a text behind it
  local id, at = raw:match("^%*(%d+)()")
  if not id then return nil end
  for _, word in ipairs(spec.text_words) do
    local text = sub(raw, at + #word, -2)
    if sub(raw, at, at + #word - 1):upper() == word and text:match("^[^%c#%*\128-\255]+$") then
      return id, word, text, at + #word
    end
  end
end

function describe.lss(spec, raw, kind)
  local f = {kind = kind}
  if kind == 0 then
    local id, word, at, number, rest = raw:match("^#(%d+)(%a+)()(%-?%d*)(.-)\r$")
    if not id then return nil end
    local sent = word:upper()
    local known = spec.words[sent]
    f.id, f.op, f.word, f.number = tonumber(id), known and known.name or sent, known, tonumber(number)
    f.token, f.at, f.width = query_form(sent), at - 1, #number
    f.id_at, f.id_width, f.op_at, f.op_width = 1, #id, 1 + #id, #word
    if known and known.query then
      f.asks, f.many = true, f.id == spec.all
      if number ~= "" and rest == "" and f.number >= 0 then f.address = f.number end
      f.number = nil
    else
      f.asks = not known and sub(sent, 1, 1) == "Q"
      f.modifiers = {}
      local where = at + #number
      for name, value in rest:gmatch("(%a+)(%d+)") do
        f.modifiers[#f.modifiers + 1] = {name:upper(), tonumber(value), where + #name - 1, #value}
        where = where + #name + #value
      end
    end
    if f.asks and (f.id == spec.all or f.id == spec.button) then f.alt = true end
    return f
  end
  local id, word, at, number = raw:match("^%*(%d+)(%a+)()(%-?%d*)\r$")
  if not id or not (spec.words[query_form(word:upper())] or {}).query then
    local own, long, text, where = text_reply(spec, raw)
    if own then id, word, at, number, f.text = own, long, where, "", text end
  end
  if not id then
    id, at = raw:match("^%*[Qq][Ii][Dd]()(%d+)\r$")
    if not id then return nil end
    id, at, number, word = at, id, at, "QID"
  end
  f.id, f.op = tonumber(id), query_form(word:upper())
  f.token, f.at, f.number = f.op, at - 1, tonumber(number)
  f.width = f.text and #f.text or #number
  f.word = spec.words[f.op]
  f.itself = f.word and f.word.plain
  return f
end

function values_in.lss(spec, state, f)
  local out = {}
  local word = f.asked and f.asked.word or f.word
  if not word then return out end
  local m = model_of(spec, state, f.id)
  local index = word.registers and word.registers[m]
  if f.kind == 1 then
    local selector = f.asked and f.asked.address or 0
    index = word.answers and word.answers[m][selector]
  end
  local reg = index and spec.registers[index]
  if reg and f.number and reg.type == "decimal" then
    out[1] = {f.id, reg, f.at, f.width, f.number}
  end
  for _, one in ipairs(f.modifiers or out) do
    local of = spec.modifiers[one[1]]
    if of and of[m] then
      out[#out + 1] = {f.id, spec.registers[of[m]], one[3], one[4], one[2]}
    end
  end
  return out
end

-- The model, by the text with which a servo answers which it is.
local function named(spec, state, f)
  local word = f.asked and f.asked.word or f.word
  if not (f.text and word and word.identifies) then return state end
  for m, told in ipairs(spec.names) do
    local is = told.texts[f.text]
    for _, begin in ipairs(told.begins) do is = is or sub(f.text, 1, #begin) == begin end
    if is and told_of(state, f.id).model ~= m then return with(state, f.id, "model", m) end
  end
  return state
end

---------------------------------------------------------------------------------------------- wCK

function describe.wck(spec, raw, kind)
  local n = #raw
  if sub(raw, 1, #spec.controller) == spec.controller and n > #spec.controller + 6 then
    local type = byte(raw, #spec.controller + 1)
    local sum = FOLDS.xor8(raw, #spec.controller + 7, n - 1)
    return {kind = kind, op = spec.types[type] or format("rbc_%02x", type), sum = {sum, byte(raw, n)},
      asks = kind == 0}
  end
  if kind == 1 then return n == 2 and {kind = 1, bare = true} or nil end
  if n < 4 then return nil end
  local data1, data2 = byte(raw, 2, 3)
  local op
  for _, one in ipairs(spec.by_first[data1] or {}) do
    if one.seconds[data2] then op = one; break end
  end
  if not op or byte(raw, 1) ~= spec.header or n < op.least then return nil end
  if op.most and n > op.most then return nil end
  local f = {kind = 0, command = op, op = op.name, asks = op.reply}
  if op.unknown then f.op = format("unknown_%02x", data2) end
  f.id_at, f.op_at = not op.nobody and (op.id_at or 1) or nil, 2
  if op.id_at then f.id = byte(raw, op.id_at + 1) elseif not op.nobody then f.id = data1 % 32 end
  f.alt = op.nobody or nil
  f.sum = {FOLDS.xor7(raw, op.sum_from + 1, n - 1), byte(raw, n)}
  if op.text_sum and f.sum[1] ~= f.sum[2] then  -- the section and note 5 of the manual differ
    local without = bxor(f.sum[1], byte(raw, 4) % 128)
    if without == f.sum[2] then f.sum[1] = without end
  end
  return f
end

local function ten_bits(state, h3, l7)  -- where L7 stands in its byte only the bus tells
  local right = state.low and not state.high
  return (h3 % 8) * 128 + (right and l7 % 128 or floor(l7 / 2))
end

-- Whether a 10-bit position has shown its lowest or its highest bit.
local function shown(state, reads, raw)
  for _, one in ipairs(reads) do
    if one.ten then
      local l7 = byte(raw, one.at + 2) or 0
      local low, high = state.low or l7 % 2 == 1, state.high or l7 > 127
      if low ~= state.low or high ~= state.high then
        state = {servos = state.servos, low = low, high = high}
      end
    end
  end
  return state
end

local function reads_of(spec, f, raw)
  if f.kind == 1 then
    return f.asked and f.asked.command and f.asked.command.back or {}
  end
  return f.command and (f.command.counted and f.command.counted[#raw - 4] or f.command.out) or {}
end

function values_in.wck(spec, state, f, raw)
  local out, registers = {}, spec.models[1].registers
  for _, one in ipairs(reads_of(spec, f, raw)) do
    local v = byte(raw, one.at + 1)
    if not v then break end
    if one.ten then v = ten_bits(state, v, byte(raw, one.at + 2))
    else v = bits_of(v, one.shift or 0, one.mask or 255) end
    out[#out + 1] = {one.servo or f.id, registers[one.reg], one.at, one.ten and 2 or 1, v}
  end
  return out
end

for _, spec in pairs(PROTOCOLS) do  -- tables that would be long to write out
  if spec.words then
    spec.registers = {}
    for _, model in ipairs(spec.models) do
      for _, reg in ipairs(model.registers) do table.insert(spec.registers, reg) end
    end
  end
  if spec.ops then
    spec.by_first = {}
    local function each(ranges, put)
      for i = 1, #ranges, 2 do for k = ranges[i], ranges[i + 1] do put(k) end end
    end
    for _, op in ipairs(spec.ops) do
      local seconds = {}
      each(op.seconds, function(k) seconds[k] = true end)
      op.seconds = seconds
      each(op.firsts, function(k)
        spec.by_first[k] = spec.by_first[k] or {}
        table.insert(spec.by_first[k], op)
      end)
    end
  end
end
