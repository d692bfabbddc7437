"""Effects of writing verbs on existing files: a table of verbs x (input, existing file, full disk, kill).

usage: writers_test.py BOLO [CASE...]. Every cell is a run of the program whose files are compared byte by byte
afterwards; "kept" means that nothing was lost. The full disk is a file system in memory of a mount namespace; where the
kernel gives none, the exit code is 77.

  input      an output is an input, by its name, a symbolic and a hard link, with --overwrite: refused, exit code 2
  existing   each output is there: refused, exit code 2; with --overwrite written, exit code 0
  full disk  no room, and room for a part, with --overwrite: exit code 1, one line, outputs and inputs as they were
  missing    no input is there, nor the outputs' folder: refused, exit code 2, nothing is left behind
  kill       SIGKILL at several moments, with --overwrite: each output is the old one or a whole new one
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from programs import Programs, wait_for

OLD = b"an older file of the same name\n"
KILLS = 4


class Case:
    """`words`: the command line, with {o} for the folder of the outputs and {i} for that of the inputs. `swap`: the output
    whose name is replaced by an input's, and the input."""

    def __init__(self, words, inputs, outputs, swap=None, free=(0, 1400)):
        self.words, self.inputs, self.outputs, self.swap, self.free = words.split(), inputs, outputs, swap, free


CASES = {
    "simulate": Case("simulate -o {o}/a.h5 --trajectory {i}/t.csv --frames 300 --width 160 --height 120", ["t.csv"],
                     ["a.h5"], ("{o}/a.h5", "t.csv")),
    "convert .h5": Case("convert {i}/big.h5 -o {o}/b.h5", ["big.h5"], ["b.h5"], ("{o}/b.h5", "big.h5")),
    "convert .mcap": Case("convert {i}/big.h5 -o {o}/b.mcap", ["big.h5"], ["b.mcap"], ("{o}/b.mcap", "big.h5")),
    "convert .tiff": Case("convert {i}/big.h5 -o {o}/b.tiff", ["big.h5"], ["b.tiff"], ("{o}/b.tiff", "big.h5")),
    "convert .png": Case("convert {i}/one.png -o {o}/b.png", ["one.png"], ["b.png"], ("{o}/b.png", "one.png"), (0,)),
    "convert .mp4": Case("convert {i}/big.h5 -o {o}/b.mp4", ["big.h5"], ["b.mp4"], ("{o}/b.mp4", "big.h5"), (0,)),
    "recover": Case("recover {i}/cut.h5 -o {o}/r.h5", ["cut.h5"], ["r.h5"], ("{o}/r.h5", "cut.h5")),
    "deblur": Case("deblur {i}/big.h5 -o {o}/d.h5 --points {i}/p.csv --profile {i}/c.toml", ["big.h5", "p.csv", "c.toml"],
                   ["d.h5"], ("{o}/d.h5", "p.csv"), (0,)),
    "calibrate": Case("calibrate {i}/chopper.h5 -o {o}/c.toml --maps {o}/m.h5 --plot {o}/f.svg",
                      ["chopper.h5"], ["c.toml", "m.h5", "f.svg"], ("{o}/m.h5", "chopper.h5"), (0,)),
    "diagnose": Case("diagnose {i}/chopper.h5 {i}/flat.h5 -o {o} --write-profile {o}/p.toml --threads 1",
                     ["chopper.h5", "flat.h5"], ["report.json", "report.html", "p.toml", "p-maps.h5"],
                     ("{o}/p.toml", "chopper.h5"), (0,)),
    "blind --keep": Case("blind --kind effect-free --sessions 1 --jobs 1 --keep {o}", [],
                         ["answers.json", "nonce.txt"], None, (0,)),
    "record": Case("record {name} -o {o}/rec.h5 --frames 200", [], ["rec.h5"], None, (0, 1400)),
}


def content(file):
    with open(file, "rb") as f:
        return f.read()


def expect(good, what, *values):
    if not good:
        raise AssertionError(" ".join([what] + [str(value) for value in values]))


class Table:
    def __init__(self, bolo, folder, programs):
        self.bolo, self.folder, self.programs = bolo, folder, programs
        self.inputs = os.path.join(folder, "inputs")
        os.mkdir(self.inputs)

    def run(self, words, **how):
        return subprocess.run([self.program(words)] + words, capture_output=True, text=True, **how)

    def program(self, words):
        return self.bolo + "-lab" if words[0] in ("eval", "bench", "blind") else self.bolo

    def prepare(self):
        i = self.inputs
        with open(f"{i}/t.csv", "w", encoding="utf-8") as f:
            f.write("t_s,x_px,y_px\n" + "".join(f"{k},{k * 50},0\n" for k in range(-3, 9)))
        with open(f"{i}/p.csv", "w", encoding="utf-8") as f:
            f.write("".join(f"{x},{y}\n" for y in range(30) for x in range(150)))
        with open(f"{i}/c.toml", "w", encoding="utf-8") as f:
            f.write("tau_s = 0.011\n")
        for words in (f"simulate -o {i}/big.h5 --frames 120 --width 160 --height 120 --no-truth",
                      f"simulate -o {i}/chopper.h5 --stimulus chopper --width 16 --height 12 --no-truth "
                      "--effect tau_spread:rms=0.05 --effect fpn_offset",
                      f"simulate -o {i}/flat.h5 --stimulus uniform --frames 100 --width 16 --height 12 --no-truth "
                      "--effect fpn_offset",
                      f"simulate -o {i}/still.h5 --stimulus uniform --frames 1 --width 32 --height 24 --no-truth",
                      f"convert {i}/still.h5 -o {i}/one.png"):
            done = self.run(words.split())
            expect(done.returncode == 0, words, done.stderr)
        with open(f"{i}/cut.h5", "wb") as f:
            f.write(content(f"{i}/big.h5")[:-200_000])

    def start_daemon(self):
        self.programs.start_replay(f"{self.inputs}/big.h5")
        wait_for(lambda: os.path.exists(f"/dev/shm/bolo.{self.programs.name}"), "the daemon")

    def words(self, words, outputs, *more):
        return [word.format(i=self.inputs, o=outputs, name=self.programs.name) for word in words] + list(more)

    def old_outputs(self, names, outputs):
        for name in names:
            with open(f"{outputs}/{name}", "wb") as f:
                f.write(OLD)

    def contents(self, case):
        return {name: content(f"{self.inputs}/{name}") for name in case.inputs}

    def kept(self, before, what):
        for name, bytes_ in before.items():
            expect(content(f"{self.inputs}/{name}") == bytes_, what, name, "was changed")

    def refused(self, case, words, what):
        before = self.contents(case)
        done = self.run(words)
        expect(done.returncode == 2, what, "exit code", done.returncode, done.stderr)
        expect(done.stderr.count("\n") == 1, what, done.stderr)
        self.kept(before, what)

    def input(self, case, outputs):
        if case.swap is None:
            return "reads none"
        output, name = case.swap
        real = f"{self.inputs}/{name}"
        ending = os.path.splitext(output)[1]
        given = {"its name": real} if ending == os.path.splitext(name)[1] else {}
        for kind, link in (("soft", os.symlink), ("hard", os.link)):
            given[kind] = f"{outputs}/{kind}{ending}"
            link(real, given[kind])
        for kind, file in given.items():
            words = [file if word == output else word for word in case.words]
            self.refused(case, self.words(words, outputs, "--overwrite"), kind)
        return "kept"

    def missing(self, case, outputs):
        if not case.inputs:
            return "reads none"
        self.refused(case, [word.format(i=f"{outputs}/no", o=f"{outputs}/new") for word in case.words], "no input")
        expect(os.listdir(outputs) == [], "left behind", *os.listdir(outputs))
        return "kept"

    def existing(self, case, outputs):
        for name in case.outputs:
            self.old_outputs([name], outputs)
            self.refused(case, self.words(case.words, outputs), f"{name} is there")
            expect(content(f"{outputs}/{name}") == OLD, name, "was changed")
            os.remove(f"{outputs}/{name}")
        self.old_outputs(case.outputs, outputs)
        done = self.run(self.words(case.words, outputs, "--overwrite"))
        expect(done.returncode == 0, "--overwrite", done.returncode, done.stderr)
        replaced = [name for name in case.outputs if content(f"{outputs}/{name}") != OLD]
        expect(replaced and set(case.outputs) - set(replaced) <= {"p-maps.h5", "m.h5"}, "--overwrite replaced only", replaced)
        return "kept"

    def full_disk(self, case, outputs):
        for free_kb in case.free:
            before = self.contents(case)
            subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", outputs], check=True)
            try:
                self.old_outputs(case.outputs, outputs)
                fill(outputs, free_kb)
                done = self.run(self.words(case.words, outputs, "--overwrite"))
                what = f"{free_kb} kB free:"
                expect(done.returncode == 1, what, "exit code", done.returncode, done.stderr)
                lines = [line for line in done.stderr.splitlines() if not line.startswith("diagnose:") and "sealed" not in line]
                expect(len(lines) == 1, what, done.stderr)
                for name in case.outputs:
                    new = content(f"{outputs}/{name}")
                    expect(new == OLD or (name == "rec.h5" and self.whole(f"{outputs}/{name}")), what, name, "was changed")
                self.kept(before, what)
            finally:
                subprocess.run(["umount", outputs], check=True)
        return "kept"

    def whole(self, file):
        end = {".svg": b"</svg>", ".html": b"</html>"}.get(os.path.splitext(file)[1])
        if end is not None:
            return content(file).rstrip().endswith(end)
        if file.endswith(".toml"):
            return b"tau_s" in content(file)
        if file.endswith(".h5") and os.path.basename(file) not in ("p-maps.h5", "m.h5"):
            return self.run(["info", file]).returncode == 0
        return len(content(file)) > 0

    def kill(self, case, outputs):
        before = self.contents(case)
        self.old_outputs(case.outputs, outputs)
        begin = time.monotonic()
        self.run(self.words(case.words, outputs, "--overwrite"))
        lasts = time.monotonic() - begin
        for k in range(KILLS):
            self.old_outputs(case.outputs, outputs)
            program = subprocess.Popen([self.program(case.words)] + self.words(case.words, outputs, "--overwrite"),
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(lasts * (k + 0.9) / KILLS)
            program.send_signal(signal.SIGKILL)
            program.wait()
            for name in case.outputs:
                new = content(f"{outputs}/{name}")
                expect(new == OLD or self.whole(f"{outputs}/{name}"), f"kill {k}:", name, "is neither old nor new")
            self.kept(before, f"kill {k}")
        return "kept"

    def cell(self, case, column):
        outputs = tempfile.mkdtemp(dir=self.folder)
        try:
            return column(case, outputs)
        except AssertionError as lost:
            return f"LOST: {lost}"
        finally:
            shutil.rmtree(outputs)


def fill(folder, free_kb):
    with open(f"{folder}/filler", "wb", buffering=0) as f:
        try:
            while True:
                f.write(b"x" * 4096)
        except OSError:
            pass
    with open(f"{folder}/filler", "r+b") as f:
        f.truncate(max(0, os.path.getsize(f"{folder}/filler") - free_kb * 1024))


def main(bolo, chosen):
    with tempfile.TemporaryDirectory() as folder, Programs(bolo, None, folder, f"test-writers-{os.getpid()}") as programs:
        table = Table(bolo, folder, programs)
        bad = []
        table.prepare()
        print(f"{'':20}{'input':16}{'existing':16}{'full disk':16}{'missing':16}{'kill':16}")
        for name, case in CASES.items():
            if chosen and name not in chosen:
                continue
            if name == "convert .mp4" and shutil.which("ffmpeg") is None:
                print(f"{name:20}no ffmpeg here")
                continue
            if name == "record":
                table.start_daemon()
            columns = (table.input, table.existing, table.full_disk, table.missing, table.kill)
            cells = [table.cell(case, column) for column in columns]
            print(f"{name:20}" + "".join(f"{cell:16}" for cell in cells), flush=True)
            bad += [f"{name}: {cell}" for cell in cells if cell.startswith("LOST")]
    return "\n".join(bad)


if __name__ == "__main__":
    if os.environ.get("BOLO_OWN_MOUNTS") != "1":
        environment = dict(os.environ, BOLO_OWN_MOUNTS="1")
        for how in (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"]):
            if subprocess.run(how + ["true"], capture_output=True, check=False).returncode == 0:
                os.execvpe("unshare", how + [sys.executable] + sys.argv, environment)
        print("skipped: the kernel gives no mount namespace here, so no disk can be full")
        sys.exit(77)
    sys.exit(main(os.path.abspath(sys.argv[1]), sys.argv[2:]) or 0)
