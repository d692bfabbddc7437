"""systemctl reload applies live keys and names those that need a restart; a broken file changes nothing."""

import time

from frames import published
from guest import CONFIG, check, is_active, journal, main_pid, run, saw, wait_until

UNIT = "bolod@test"
FILE = CONFIG / "test.toml"


def reload(text: str) -> list[str]:
    """The daemon's messages about a configuration with this text."""
    FILE.write_text(text)
    since = time.time()
    before = published("test")
    run("systemctl", "reload", UNIT)
    check(is_active(UNIT) and main_pid(UNIT) == pid, "the daemon did not stay the same process")
    wait_until("more frames", lambda: published("test") > before)
    messages = [entry["MESSAGE"] for entry in journal("-u", UNIT, "BOLO_EVENT=reload", since=since)]
    print(messages)
    return messages


pid = main_pid(UNIT)
original = FILE.read_text()
text = original + '\n[log]\nlevel = "debug"\n'
check(reload(text) == ["reload: took up log.level"], "the live key was not taken up")
messages = reload(text.replace("slots = 1024", "slots = 512"))
check(any("needs a restart: shm.slots" in message for message in messages), "shm.slots is not named")
messages = reload(text.replace("slots = 1024", 'slots = "many"'))
check(len(messages) == 1 and "all stays as it was" in messages[0], "a broken file is not one line")
saw(messages[0])
reload(original)
