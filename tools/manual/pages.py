#!/usr/bin/env python3
"""Writes the manual pages: pages.py BOLO BOLOD CONFIG FOLDER VERSION DATE [EMULATOR...].

Pages of commands come from their --help, those of settings from the commented files in CONFIG: nothing is said twice.
EMULATOR runs programs of another processor.
"""

import pathlib
import re
import subprocess
import sys

EXIT = ("0: done. 1: failed while running. 2: wrong usage, configuration or input, with one line on standard error that "
        "says what, where and what to do.")
ABOUT = ("Undoes the thermal inertia of the pixels of an uncooled microbolometer camera: simulates, records, replays, "
         "calibrates and diagnoses, and asks the running daemon, bolod(8). Each verb has a page of its own.")
DAEMON = {
    "AS A SERVICE": "bolod@NAME.service runs /etc/bolo/NAME.toml as the user bolo, watched and confined. What a camera "
                    "needs beyond that goes into a drop-in (systemctl edit bolod@NAME): IPAddressAllow= for a camera "
                    "with a public address, BindReadOnlyPaths= for captures in /home. bolo-fakecam.service is a camera "
                    "without hardware, and bolod@demo takes its frames.",
    "SIGNALS": "SIGTERM and SIGINT end it in good order. SIGHUP has it read its configuration again: systemctl reload.",
    "EXIT STATUS": EXIT + " Started by systemd it ends with 1 also when the camera does not answer yet, to be tried "
                          "again.",
    "FILES": "/etc/bolo/NAME.toml: what bolod@NAME.service runs; bolod.toml(5) has every key.\n\n/dev/shm/bolo.NAME: the "
             "frames.\n\n/run/bolo/NAME.sock: hears bolo-nuc(1).",
    "SEE ALSO": "bolo(1), bolod.toml(5), bolo-profile(5), bolo-doctor(1)",
}
OPTION = re.compile(r"^ {1,4}(?:-(\w), )? *--([\w-]+)(?: ([^ ]+(?: \(=[^)]*\))?))?(?:  +(.*))?$")


def roff(text):
    for plain, escaped in (("\\", "\\e"), ("-", "\\-"), ("^", "\\(ha"), ("~", "\\(ti"), ("'", "\\(aq"), ("`", "\\(ga")):
        text = text.replace(plain, escaped)
    return re.sub(r"^\.", r"\\&.", text, flags=re.M)


def bold(text):
    return f"\\fB{roff(text)}\\fR"


def italic(text):
    return f"\\fI{roff(text)}\\fR"


def section(title, text):
    return f".SH {title}\n" + "\n.PP\n".join(roff(part) for part in text.strip().split("\n\n")) + "\n"


class Writer:
    def __init__(self, folder, version, date):
        self.folder, self.version, self.date = pathlib.Path(folder), version, date

    def page(self, name, chapter, summary, body):
        head = f'.TH "{roff(name.upper())}" {chapter} {self.date} "bolo {self.version}" Bolo\n'
        file = self.folder / f"man{chapter}" / f"{name}.{chapter}"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{head}.SH NAME\n{roff(name)} \\- {roff(summary)}\n{body}")


EMULATOR = sys.argv[7:]


def help_of(*command):
    return subprocess.run([*EMULATOR, *command, "--help"], capture_output=True, text=True, check=True).stdout


def options_of(lines):
    """[(letter, name, value, text)], and group titles as (title,), from cxxopts' help."""
    found = []
    for line in lines:
        option, title = OPTION.match(line), re.match(r"^ (\w[\w ]*) options:$", line)
        if option:
            found.append([part or "" for part in option.groups()])
        elif title:
            found.append((title.group(1),))
        elif line.startswith("      ") and found and len(found[-1]) == 4:
            found[-1][3] = (found[-1][3] + " " + line.strip()).strip()
    return found


def command_body(name, text, sections):
    about, _, rest = text.partition("Usage:\n")
    usage, *lines = rest.splitlines()
    operands = usage.strip().removeprefix(name.replace("-", " ", 1) if name != "bolod" else name)
    operands = operands.replace("[OPTION...]", "").strip()
    body = f".SH SYNOPSIS\n{bold(name.replace('-', ' ', 1))} [{italic('OPTION')}...] {italic(operands) if operands else ''}".rstrip()
    body += "\n" + section("DESCRIPTION", about) + ".SH OPTIONS\n"
    for option in options_of(lines):
        if len(option) == 1:
            body += f".SS {roff(option[0])}\n"
            continue
        letter, long, value, says = option
        body += ".TP\n" + (bold("-" + letter) + ", " if letter else "") + bold("--" + long)
        body += (" " + italic(value) if value else "") + "\n" + roff(says or "As it is called.") + "\n"
    return body + "".join(section(title, text) for title, text in sections.items())


def settings_body(document):
    """Page for a settings file; each key follows its comment, whose last line has type and default."""
    head, keys = [], ".SH KEYS\n"
    blocks = [block.splitlines() for block in re.split(r"\n\s*\n", document.strip())]
    while blocks and all(line.startswith("# ") or line == "#" for line in blocks[0]):
        head += [line[2:] for line in blocks.pop(0)]
    for comments in blocks:
        about = []
        for line in comments:
            key = re.match(r"#?(\w+) = ", line)
            if line.startswith("["):
                name, _, says = line.partition("#")
                keys += f".SS {roff(name.strip())}\n" + (roff(says.strip()) + "\n" if says else "")
            elif key:
                text = "\n".join(roff(part) for part in about[:-1]) + ("\n.br\n" if len(about) > 1 else "")
                keys += f".TP\n{bold(key.group(1))}\n{text}{roff(about[-1]) if about else roff(line)}\n"
                about = []
            elif line.startswith("# "):
                about.append(line[2:])
    return section("DESCRIPTION", "\n".join(head)) + keys


def main(bolo, bolod, config, folder, version, date):
    writer = Writer(folder, version, date)
    verbs = re.findall(r"^  (\w+) +(\S.*)$", help_of(bolo), re.M)
    listed = "".join(f".TP\n.BR {roff('bolo-' + verb)} (1)\n{roff(says)}\n" for verb, says in verbs)
    synopsis = f".SH SYNOPSIS\n{bold('bolo')} {italic('VERB')} [{italic('OPTION')}...]\n"
    writer.page("bolo", 1, "sharp frames from moving thermal cameras",
                synopsis + section("DESCRIPTION", ABOUT) + ".SH VERBS\n" + listed + section("EXIT STATUS", EXIT) +
                section("SEE ALSO", "bolod(8), bolod.toml(5), bolo-profile(5)"))
    common = {"EXIT STATUS": EXIT, "SEE ALSO": "bolo(1), bolod(8)"}
    for verb, says in verbs:
        writer.page(f"bolo-{verb}", 1, says, command_body(f"bolo-{verb}", help_of(bolo, verb), common))
    writer.page("bolod", 8, "deblurs a thermal camera's frames, live", command_body("bolod", help_of(bolod), DAEMON))
    see = section("SEE ALSO", "bolod(8), bolo-doctor(1), bolo-calibrate(1)")
    settings = {"bolod.toml": ("bolod.toml", "configuration of bolod, one file a camera"),
                "bolo-profile": ("a655sc.toml", "what is known of one camera")}
    for name, (file, summary) in settings.items():
        writer.page(name, 5, summary, settings_body((pathlib.Path(config) / file).read_text()) + see)


if __name__ == "__main__":
    if len(sys.argv) < 7:
        sys.exit(__doc__)
    main(*sys.argv[1:7])
