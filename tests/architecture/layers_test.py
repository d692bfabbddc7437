#!/usr/bin/env python3
"""Refuses an #include that no link edge allows.

The edges are the DEPENDS lists of bolo_layer() in the CMake files, so what links and what is included cannot drift
apart. Two more rules stand beside them: the edges themselves must point downwards in the order of ARCHITECTURE.md, and
only daemon and tools may name a concrete driver.
"""

import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
LAYERS = ["core", "rt", "model", "motion", "deblur", "capture", "report", "sim", "diagnose", "pipeline", "daemon"]
# The only edges that may exist, whatever the CMake files say.
ALLOWED = {
    "core": set(),
    "rt": {"core"},
    "model": {"core"},
    "motion": {"core"},
    "deblur": {"core", "model", "motion"},
    "capture": {"core", "model"},
    "sim": {"core", "rt", "model", "capture"},
    "report": {"core"},
    "diagnose": {"core", "model", "capture", "report"},
    "pipeline": {"core", "rt", "model", "deblur"},
}
DRIVER_MAY_USE = {"core", "rt", "model", "deblur", "capture", "pipeline"}
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.M)


def drivers(root):
    return sorted(p.name for p in (root / "drivers").iterdir() if p.is_dir())


def link_edges(root):
    """{layer: set of layers} from every bolo_layer() call."""
    edges = {}
    for cmake in [*root.glob("src/**/CMakeLists.txt"), *root.glob("drivers/**/CMakeLists.txt"), *root.glob("tools/bolod/CMakeLists.txt")]:
        for name, body in re.findall(r"bolo_layer\((\w+)([^)]*)\)", cmake.read_text()):
            depends = re.search(r"DEPENDS\s+((?:(?!SOURCES|LIBRARIES|DEPENDS)\w+\s*)+)", body)
            edges[name] = set(depends.group(1).split()) if depends else set()
    return edges


def owner(path, root):
    """The layer, driver or folder that a source file belongs to."""
    parts = path.relative_to(root).parts
    if parts[0] == "include":
        return parts[2] if len(parts) > 3 else "core"  # include/bolo/shm_layout.h stands alone
    if parts[0] in ("src", "drivers"):
        return parts[1]
    return parts[0]


def target(include):
    """The layer or driver that an #include names, or None when it is not ours."""
    parts = include.split("/")
    if parts[0] == "bolo" and len(parts) == 3:
        return parts[1]
    if parts[0] in ("src", "drivers") and len(parts) >= 3:
        return parts[1]
    return None


def violations(root):
    edges = link_edges(root)
    known_drivers = drivers(root)
    found = []
    for name, depends in sorted(edges.items()):
        if name in known_drivers:
            wrong = depends - DRIVER_MAY_USE
        elif name == "daemon":
            wrong = depends - set(LAYERS) - set(known_drivers) - {"sim", "diagnose"}
        else:
            wrong = depends - ALLOWED.get(name, set())
        found += [f"CMake: {name} may not depend on {w}" for w in sorted(wrong)]
    for folder in ("include", "src", "drivers"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in (".hpp", ".cpp", ".h", ".c"):
                continue
            here = owner(path, root)
            for include in INCLUDE.findall(path.read_text()):
                there = target(include)
                if there is None or there == here or there in edges.get(here, set()):
                    continue
                found.append(f"{path.relative_to(root)}: {here} includes {include}, but does not depend on {there}")
    return found


class Layers(unittest.TestCase):
    def test_every_include_follows_a_link_edge(self):
        self.assertEqual(violations(ROOT), [])

    def test_every_layer_is_known(self):
        self.assertLessEqual({"core", "rt", "model", "deblur", "capture", "pipeline"}, set(link_edges(ROOT)))

    def test_a_wrong_include_is_refused(self):
        import shutil
        import tempfile

        with tempfile.TemporaryDirectory() as scratch:
            copy = pathlib.Path(scratch)
            for folder in ("include", "src", "drivers"):
                shutil.copytree(ROOT / folder, copy / folder)
            victim = copy / "src" / "rt" / "frame_pool.cpp"
            victim.write_text('#include "src/pipeline/pipeline.hpp"\n' + victim.read_text())
            self.assertTrue(any("rt includes src/pipeline" in v for v in violations(copy)))

    def test_a_layer_that_names_a_driver_is_refused(self):
        import shutil
        import tempfile

        with tempfile.TemporaryDirectory() as scratch:
            copy = pathlib.Path(scratch)
            for folder in ("include", "src", "drivers"):
                shutil.copytree(ROOT / folder, copy / folder)
            cmake = copy / "src" / "pipeline" / "CMakeLists.txt"
            cmake.write_text(cmake.read_text().replace("DEPENDS core", "DEPENDS core shm"))
            self.assertIn("CMake: pipeline may not depend on shm", violations(copy))


if __name__ == "__main__":
    sys.exit(unittest.main())
