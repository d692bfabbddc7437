"""[ros2]: bolo-ros2 runs and opens a DDS port within the unit's sandbox, and both programs keep running."""

import pathlib
import time

from guest import check, journal, main_pid, run, saw, wait_until

UNIT = "bolod@test"
PORTS = (7400, 7410)  # for ROS_DOMAIN_ID 0, with and without multicast: DDSI-RTPS 9.6.1


def child() -> str:
    found = run("pgrep", "-P", str(main_pid(UNIT)), "bolo-ros2", expect=None).strip()
    check(found.count("\n") == 0, f"more than one: {found}")
    return found


def listens() -> bool:
    sockets = pathlib.Path("/proc/net/udp").read_text()
    return any(f":{port:04X} " in sockets for port in PORTS)


wait_until("bolo-ros2 runs", child)
wait_until("DDS listens", listens)
first = child()
time.sleep(5.0)
check(child() == first, "bolo-ros2 was started again")
check(not [e for e in journal("-u", UNIT) if "bolo-ros2 ended" in e["MESSAGE"]], "the journal tells of an end")
saw(pathlib.Path(f"/proc/{first}/cgroup").read_text().strip())
