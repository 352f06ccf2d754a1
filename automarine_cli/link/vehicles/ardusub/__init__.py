"""ArduSub over MAVLink: the link, what is checked before a run, sticks, and the run itself.

Sources: ArduPilot, ArduSub/joystick.cpp, mode_manual.cpp, mode_stabilize.cpp, failsafe.cpp, GCS_MAVLink_Sub.cpp and
libraries/RC_Channel/RC_Channel.cpp; MAVLink, common message set (MANUAL_CONTROL, HEARTBEAT, PARAM_VALUE).
"""
