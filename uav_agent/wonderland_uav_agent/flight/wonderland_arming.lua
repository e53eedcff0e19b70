-- ArduPilot: no arming without a permission of the ledger. Goes into APM/scripts; needs SCR_ENABLE = 1.
-- The companion computer sets WNDL_PERMIT to the seconds for which the vehicle may be armed once a verdict that
-- permits the take-off is committed. What goes round it: force-arming (param2 = 21196), and whoever may set parameters.
local WARNING = 4
local KEY = 87
assert(param:add_table(KEY, "WNDL_", 1), "Wonderland: no room for its parameter")
assert(param:add_param(KEY, 1, "PERMIT", 0), "Wonderland: no room for its parameter")
local permit = Parameter("WNDL_PERMIT")
permit:set_and_save(0) -- what was permitted before a restart is not any more
local auth = arming:get_aux_auth_id()
assert(auth, "Wonderland: no authorisation id is left")
local until_ms = uint32_t(0)
local permitted = false

local function update()
  local seconds = permit:get() or 0
  if seconds > 0 then
    until_ms = millis() + uint32_t(math.floor(seconds * 1000))
    permitted = true
    permit:set_and_save(0)
    gcs:send_text(WARNING, "Wonderland: take-off permitted")
  elseif seconds < 0 then
    permitted = false
    permit:set_and_save(0)
  end
  if permitted and millis() > until_ms then
    permitted = false
  end
  if permitted then
    arming:set_aux_auth_passed(auth)
  else
    arming:set_aux_auth_failed(auth, "no permission of the ledger")
  end
  return update, 100
end

return update()
