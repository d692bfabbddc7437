// Instruction sets that kernels are compiled for; included before Highway.
#pragma once

#define HWY_COMPILE_ALL_ATTAINABLE
// arm64: Highway's NEON target requires the AES extension, which the Raspberry Pi 4 lacks, unless Highway cannot query
// the processor: then NEON is the baseline. SVE vectors have no size at compile time: structures cannot hold them.
#define TOOLCHAIN_MISS_SYS_AUXV_H
#define BOLO_NO_SVE (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#ifdef BOLO_FEW_TARGETS  // sanitizers: one set beside the baseline is enough
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3 | HWY_AVX3_DL | BOLO_NO_SVE)
#else
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | BOLO_NO_SVE)
#endif
