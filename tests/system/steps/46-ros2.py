"""[ros2]: bolo-ros2 runs within the unit's confinement, opens DDS' port there, and neither ends."""

import pathlib
import time

from guest import check, journal, main_pid, run, saw, wait_until

UNIT = "bolod@test"
DISCOVERY_PORT = 7400  # of ROS_DOMAIN_ID 0: DDSI-RTPS 9.6.1


def child() -> str:
    found = run("pgrep", "-P", str(main_pid(UNIT)), "bolo-ros2", expect=None).strip()
    check(found.count("\n") == 0, f"more than one: {found}")
    return found


def listens() -> bool:
    return f":{DISCOVERY_PORT:04X} " in pathlib.Path("/proc/net/udp").read_text()


wait_until("bolo-ros2 runs", child)
wait_until("DDS listens", listens)
first = child()
time.sleep(5.0)
check(child() == first, "bolo-ros2 was started again")
check(not [entry for entry in journal("-u", UNIT) if "bolo-ros2" in entry["MESSAGE"]], "the journal tells of bolo-ros2")
saw(pathlib.Path(f"/proc/{first}/cgroup").read_text().strip())
