"""Loopback addresses of a test's own."""

import os


def own_address(number=0):
    """An address that no other test has: all 22 bits of the process id are in it. `number`: 0 to 1, of several."""
    pid = os.getpid()
    return f"127.{64 + 65 * number + pid // 65024}.{pid // 254 % 256}.{1 + pid % 254}"
