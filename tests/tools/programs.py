"""What tests of running programs share: waiting for what they do, addresses and ports of a test's own."""

import os
import socket
import time


def own_address(number=0):
    """A loopback address that no other test has: all 22 bits of the process id are in it. `number`: 0 to 1, of several."""
    pid = os.getpid()
    return f"127.{64 + 65 * number + pid // 65024}.{pid // 254 % 256}.{1 + pid % 254}"


def free_port():
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return server.getsockname()[1]


def wait_for(look, what, hang_guard_s=60.0):
    """What look() finds, once it finds something."""
    end = time.monotonic() + hang_guard_s
    while not (found := look()):
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.01)
    return found
