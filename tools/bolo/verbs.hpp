// The verbs of `bolo`, one source file each.
#pragma once

#include <array>

#include "tools/cli/cli.hpp"

namespace bolo::tools {

int bench_main(int argc, char** argv);
int calibrate_main(int argc, char** argv);
int convert_main(int argc, char** argv);
int deblur_main(int argc, char** argv);
int demo_main(int argc, char** argv);
int diagnose_main(int argc, char** argv);
int doctor_main(int argc, char** argv);
int fakecam_main(int argc, char** argv);
int info_main(int argc, char** argv);
int nuc_main(int argc, char** argv);
int record_main(int argc, char** argv);
int recover_main(int argc, char** argv);
int replay_main(int argc, char** argv);
int simulate_main(int argc, char** argv);
int stat_main(int argc, char** argv);
int usb_main(int argc, char** argv);
int view_main(int argc, char** argv);

// The simulator's effects with stage, keys and forms; the fake camera's faults with keys. A table or a JSON array.
void print_effects(bool json);
void print_faults(bool json);

inline constexpr auto kVerbs = std::to_array<Verb>({
    {"demo", "simulated camera, daemon and live page at once: what Bolo does", demo_main},
    {"simulate", "write a capture of a simulated camera that moves", simulate_main},
    {"fakecam", "serve a capture as a GigE Vision camera", fakecam_main},
    {"deblur", "undo the pixels' thermal inertia in a capture", deblur_main},
    {"calibrate", "measure a camera's time constant, noise and pixels; write its profile", calibrate_main},
    {"diagnose", "say how far the simulator is from a camera, why, and what closes the gap", diagnose_main},
    {"record", "record a running daemon's frames", record_main},
    {"recover", "save what an interrupted recording or a damaged capture holds", recover_main},
    {"convert", "captures, pictures, raw dumps and radiometric stills into one another", convert_main},
    {"replay", "publish a capture as if its camera was live", replay_main},
    {"stat", "show what a running daemon does", stat_main},
    {"view", "show a running daemon's frames on a live page in the browser", view_main},
    {"nuc", "have a running daemon's camera correct its pixels", nuc_main},
    {"doctor", "check this computer for what a camera needs, and say the fixes", doctor_main},
    {"usb", "list USB cameras and what they say of themselves (experimental)", usb_main},
    {"info", "say what is in a capture, and what is wrong with it", info_main},
    {"bench", "say how many times faster than the camera this computer deblurs", bench_main},
});

}  // namespace bolo::tools
