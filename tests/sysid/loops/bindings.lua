-- Stubs of the bindings of ArduPilot's Lua scripts, and a craft whose attitude follows the rates that it is sent.
-- lua5.3 bindings.lua SCRIPT SECONDS LEAN_AT: prints one row for each command, then how the script ended.
local script, seconds, lean_at = arg[1], tonumber(arg[2]), tonumber(arg[3])
local now, mode, roll, pitch = 5.0, 4, 0.0, 0.0
local rates = { 0.0, 0.0, 0.0 }

local function number_of(value)
  return setmetatable({}, { __index = { tofloat = function() return value end } })
end

function millis() return number_of(now * 1000.0) end
vehicle = {
  get_mode = function() return mode end,
  set_mode = function(_, to) mode = to return true end,
  set_target_rate_and_throttle = function(_, r, p, y, throttle)
    rates = { r, p, y }
    print(string.format("%.4f %.6f %.6f %.6f %.6f %.6f %.6f", now - 5.0, r, p, y, throttle, roll, pitch))
    return true
  end,
}
arming = { is_armed = function() return true end }
ahrs = {
  get_roll = function() return now - 5.0 > lean_at and 0.6 or roll end,
  get_pitch = function() return pitch end,
  get_relative_position_D_home = function() return -20.0 end,
  get_velocity_NED = function() return { z = function() return 0.0 end } end,
}
gcs = { send_text = function(_, _, text) print("# " .. text) end }

local step, wait = dofile(script)
while now < 5.0 + seconds and mode == 4 do
  local dt = wait / 1000.0
  now = now + dt
  roll, pitch = roll + math.rad(rates[1]) * dt, pitch + math.rad(rates[2]) * dt
  step, wait = step()
end
print("# mode " .. mode)
