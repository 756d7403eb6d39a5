-- mightyZAP for tshark, with nothing in it that costs: what the bench reads, a field each, and no more.
-- Numbers are read by ranges of the packet's own buffer; nothing is kept from packet to packet, no text
-- is made, and no request is looked up. Such a dissector knows less than ours, and is the faster for it.

local zap = Proto("zap", "mightyZAP, as fast as Lua allows")
local u8, u16, byte = ProtoField.uint8, ProtoField.uint16, ProtoField.bytes
local id, code = u8("zap.id", "id"), u8("zap.code", "code")
local address, count = u8("zap.address", "address"), u8("zap.count", "count")
local position, speed = u16("zap.position", "position"), u16("zap.speed", "speed")
local load, voltage = u16("zap.load", "load"), u8("zap.voltage", "voltage")
local good = ProtoField.bool("zap.good", "the checksum holds")
zap.fields = {id, code, address, count, position, speed, load, voltage, good}

local sum = {}  -- the complement, by the sum of the bytes: no arithmetic of bits a packet
for k = 0, 255 * 64 do sum[k] = 255 - k % 256 end

function zap.dissector(buffer, packet, tree)
  local n = buffer:len()
  local total = 0
  for at = 3, n - 2 do total = total + buffer(at, 1):uint() end
  tree:add(good, sum[total] == buffer(n - 1, 1):uint())
  tree:add(id, buffer(3, 1))
  tree:add(code, buffer(5, 1))
  if n == 9 then
    tree:add(address, buffer(6, 1))
    tree:add(count, buffer(7, 1))
  elseif n == 15 then
    tree:add_le(position, buffer(6, 2))
    tree:add_le(speed, buffer(8, 2))
    tree:add_le(load, buffer(10, 2))
    tree:add(voltage, buffer(12, 1))
  end
end

DissectorTable.get("wtap_encap"):add(wtap.USER0, zap)
