#!/usr/bin/env python3
"""Refuses an #include against the direction of dependency, in every folder.

For src, drivers and bolod the edges are the DEPENDS lists of bolo_layer() in the CMake files, so that linking and
including cannot diverge; the lists themselves are limited by ALLOWED. The other folders of tools may use only those
before them in TOOLS.
"""

import pathlib
import re
import shutil
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PIPELINE = {"core", "rt", "model", "deblur", "corrections", "motion", "capture", "pipeline"}
# Allowed edges, whatever the CMake files say.
ALLOWED = {
    "core": set(),
    "rt": {"core"},
    "model": {"core"},
    "motion": {"core"},
    "deblur": {"core", "model", "motion"},
    "corrections": {"core", "model", "motion", "deblur"},
    "capture": {"core", "model"},
    "sim": {"core", "rt", "model", "capture"},
    "report": {"core"},
    "diagnose": {"core", "model", "motion", "deblur", "corrections", "capture", "report"},
    "pipeline": {"core", "rt", "model", "deblur", "corrections", "motion"},
    "daemon": PIPELINE,  # plus daemon_drivers()
}
# Folders of tools, each above the previous ones. Only the laboratory may use the laboratory.
TOOLS = ["cli", "record", "convert", "doctor", "view", "deblur", "demo", "gstreamer", "ros2", "bolod", "bolo", "manual", "lab"]
LAB = ["", "bench", "blind", "eval", "detect", "soak"]
SUFFIXES = {".hpp", ".cpp", ".h", ".c"}
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.M)


def drivers(root):
    return {p.name for p in (root / "drivers").iterdir() if p.is_dir()}


def daemon_drivers(root):
    """BOLO_DAEMON_DRIVERS of drivers/CMakeLists.txt."""
    return drivers(root) - {"fakecam"}


def link_edges(root):
    """{layer: set of layers} from every bolo_layer() call."""
    edges = {}
    for cmake in [*root.glob("src/**/CMakeLists.txt"), *root.glob("drivers/**/CMakeLists.txt"), root / "tools/bolod/CMakeLists.txt"]:
        for name, body in re.findall(r"bolo_layer\((\w+)([^)]*)\)", cmake.read_text()):
            body = body.replace("${BOLO_DAEMON_DRIVERS}", " ".join(sorted(daemon_drivers(root))))
            depends = re.search(r"DEPENDS\s+((?:(?!SOURCES|LIBRARIES|DEPENDS)\w+\s*)+)", body)
            edges[name] = set(depends.group(1).split()) if depends else set()
    return edges


def includes(root, folder):
    for path in sorted((root / folder).rglob("*")):
        if path.suffix in SUFFIXES:
            for include in INCLUDE.findall(path.read_text()):
                yield path.relative_to(root), include


def layer_of(name):
    """Layer or driver of a path, or None."""
    parts = name.split("/")
    if parts[0] in ("src", "drivers") and len(parts) > 2:
        return parts[1]
    return "daemon" if name.startswith("tools/bolod/") else None


def layer_violations(root):
    edges = link_edges(root)
    for name, depends in sorted(edges.items()):
        allowed = PIPELINE if name in drivers(root) else ALLOWED.get(name, set())
        allowed = allowed | daemon_drivers(root) if name == "daemon" else allowed
        yield from (f"CMake: {name} may not depend on {wrong}" for wrong in sorted(depends - allowed))
    for folder in ("src", "drivers", "tools/bolod"):
        for path, include in includes(root, folder):
            here, there = layer_of(str(path)), layer_of(include)
            if include.startswith("tools/") and there != "daemon":
                yield f"{path}: {here} includes {include}"
            elif there not in (None, here) and there not in edges.get(here, set()):
                yield f"{path}: {here} includes {include}, but does not depend on {there}"


def place_of(name):
    """(tool, folder of the laboratory) of a path in tools."""
    parts = name.split("/")
    return parts[1], parts[2] if parts[1] == "lab" and len(parts) > 3 else ""


def tool_violations(root):
    for path, include in includes(root, "tools"):
        if not include.startswith("tools/"):
            continue
        here, there = place_of(str(path)), place_of(include)
        if here[0] == there[0] == "lab":
            # The laboratory's own main files stand above its folders, except for the list of verbs.
            wrong = here[1] != there[1] and here[1] and LAB.index(there[1]) > LAB.index(here[1])
        else:
            wrong = there[0] not in TOOLS or TOOLS.index(there[0]) > TOOLS.index(here[0])
        if wrong:
            yield f"{path}: {'/'.join(here).rstrip('/')} includes {include}"


def violations(root):
    return [*layer_violations(root), *tool_violations(root)]


class Layers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        for folder in ("src", "drivers", "tools"):
            shutil.copytree(ROOT / folder, pathlib.Path(cls.scratch.name) / folder)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def refuses(self, file, line, message):
        """True if a copy of the tree with this line added at the start of the file is refused."""
        copy = pathlib.Path(self.scratch.name)
        victim = copy / file
        before = victim.read_text()
        victim.write_text(line + "\n" + before)
        found = violations(copy)
        victim.write_text(before)
        self.assertTrue([v for v in found if message in v], found)

    def test_every_include_follows_a_link_edge(self):
        self.assertEqual(violations(ROOT), [])

    def test_every_folder_is_known(self):
        self.assertEqual({p.name for p in (ROOT / "src").iterdir() if p.is_dir()} - set(ALLOWED), set())
        folders = {p.name for p in (ROOT / "tools").iterdir() if any(f.suffix in SUFFIXES for f in p.rglob("*"))}
        self.assertEqual(folders - set(TOOLS), set())

    def test_what_looks_up_is_refused(self):
        for file, line, message in [
                ("src/rt/frame_pool.cpp", '#include "src/pipeline/pipeline.hpp"', "rt includes src/pipeline"),
                ("src/pipeline/pipeline.cpp", '#include "drivers/shm/shm_sink.hpp"', "pipeline includes drivers/shm"),
                ("src/rt/CMakeLists.txt", "bolo_layer(invented DEPENDS core shm)", "CMake: invented may not depend on shm"),
                ("tools/bolo/deblur.cpp", '#include "tools/lab/recording.hpp"', "bolo includes tools/lab"),
                ("tools/bolod/config.cpp", '#include "src/sim/simulator.hpp"', "daemon includes src/sim"),
                ("tools/view/site.cpp", '#include "tools/bolo/verbs.hpp"', "view includes tools/bolo")]:
            with self.subTest(file):
                self.refuses(file, line, message)


if __name__ == "__main__":
    sys.exit(unittest.main())
