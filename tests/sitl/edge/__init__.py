"""The MAVSDK edge against the mock autopilot in a process of its own, over real UDP.

Nothing here depends on the mock's timing beyond what PX4 itself promises.
"""

from typing import Final

OPTIONS: Final = ("--param", "COM_DISARM_LAND=0.5", "--param", "COM_OBL_RC_ACT=5")
