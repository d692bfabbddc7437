"""Boots the virtual machine, shows what it prints, and ends with its exit code.

usage: boot.py IMAGE PAYLOAD [--shell] [--limit S]

IMAGE: the folder of image/build. PAYLOAD: the folder that the machine mounts as /payload; it runs /payload/run, which
leaves an exit code in /payload/exit_code. A machine whose systemd is not up in time is started once more: QEMU's
emulation now and then hangs in the kernel's first seconds on a busy host. Exit code 124: beyond the limit.
"""

import argparse
import pathlib
import subprocess
import sys
import threading
import time

BOOT_LIMIT_S = 180
BOOTS = 2
KERNEL_LINE = (
    "console=ttyS0 quiet panic=-1 reboot=t mitigations=off selinux=0 audit=0 random.trust_cpu=on"
    " systemd.firstboot=off systemd.log_target=journal-or-kmsg systemd.show_status=false"
)


def command(image: pathlib.Path, payload: pathlib.Path, shell: bool) -> list[str]:
    return [
        *("qemu-system-x86_64", "-M", "pc", "-accel", "tcg,thread=multi", "-cpu", "max", "-m", "2048", "-smp", "2"),
        *("-nodefaults", "-no-user-config", "-display", "none", "-no-reboot"),
        *("-serial", "mon:stdio" if shell else "stdio"),
        *("-kernel", str(image / "vmlinux"), "-initrd", str(image / "initrd.img"), "-append", KERNEL_LINE),
        *("-drive", f"file={image / 'root.ext4'},if=none,id=d,format=raw,snapshot=on"),
        *("-device", "virtio-blk-pci,drive=d"),
        *("-fsdev", f"local,id=p,path={payload},security_model=none"),
        *("-device", "virtio-9p-pci,fsdev=p,mount_tag=payload"),
        *("-object", "rng-random,filename=/dev/urandom,id=r", "-device", "virtio-rng-pci,rng=r"),
    ]


def show(console, log) -> None:
    for line in console:
        log.write(line)
        log.flush()
        print(line.rstrip(), flush=True)


def run(image: pathlib.Path, payload: pathlib.Path, deadline: float) -> bool:
    """True if the machine booted, whatever happened then."""
    booted = payload / "booted"
    booted.unlink(missing_ok=True)
    with open(payload / "console.log", "a", encoding="utf-8") as log, subprocess.Popen(
            command(image, payload, shell=False), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace") as machine:
        console = threading.Thread(target=show, args=(machine.stdout, log))
        console.start()
        boot_deadline = time.monotonic() + BOOT_LIMIT_S
        while machine.poll() is None and time.monotonic() < (deadline if booted.exists() else boot_deadline):
            time.sleep(0.2)
        machine.kill()
        console.join()
    return booted.exists()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("image", type=pathlib.Path)
    parser.add_argument("payload", type=pathlib.Path)
    parser.add_argument("--shell", action="store_true", help="the terminal is the machine's")
    parser.add_argument("--limit", type=float, default=900.0, help="s from the first start to the end")
    arguments = parser.parse_args()
    if arguments.shell:
        return subprocess.call(command(arguments.image, arguments.payload, shell=True))
    exit_code = arguments.payload / "exit_code"
    exit_code.unlink(missing_ok=True)
    deadline = time.monotonic() + arguments.limit
    for boot in range(1, BOOTS + 1):
        if run(arguments.image, arguments.payload, deadline):
            break
        print(f"the machine did not come up within {BOOT_LIMIT_S} s (start {boot} of {BOOTS})", file=sys.stderr)
    if exit_code.exists():
        return int(exit_code.read_text())
    print(f"the machine ended without a result, or was stopped after {arguments.limit:.0f} s", file=sys.stderr)
    return 124


if __name__ == "__main__":
    sys.exit(main())
