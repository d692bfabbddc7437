// Which instruction sets kernels are compiled for; included before Highway.
#pragma once

#define HWY_COMPILE_ALL_ATTAINABLE
#ifdef BOLO_FEW_TARGETS  // sanitizers: one set beside the baseline is enough to look at
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3 | HWY_AVX3_DL)
#else
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#endif
