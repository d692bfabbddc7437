// How each effect of the catalogue is said.
#pragma once

#include <array>
#include <string_view>

namespace bolo::diagnose {

// `sentence` has places for parameters: {key} is the value with its unit, {key~} how far it is from 1 in percent,
// {key?more|less} the first word when it is above its neutral value (1 for scales, 0 else), the second below.
// `plain` is said when a parameter is missing.
struct EffectWords {
  std::string_view name;
  std::string_view title;
  std::string_view plain;
  std::string_view sentence;
};

inline constexpr std::array<EffectWords, 29> kEffectWords{{
    {"tau_global", "Time constant", "All pixels answer with another time constant than the profile says",
     "All pixels answer {scale~} {scale?slower|faster} than the profile says"},
    {"tau_spread", "Spread of time constants", "Pixels differ in their time constant",
     "Pixels differ in their time constant by {rms} rms"},
    {"slow_pole", "Slow tail", "A part of the answer comes late, through a second, slower heat path",
     "{share} of the answer comes late, with a second time constant of {slow_tau_s}"},
    {"row_delay", "Row delay", "Rows are sampled one after another, not at once",
     "Rows are sampled {row_delay_s} after one another, not at once"},
    {"iir", "Frame filter", "The camera averages frames before it sends them",
     "The camera averages frames before it sends them: a new frame counts {alpha%}"},
    {"fpn_offset", "Fixed offsets", "Pixels and columns carry a fixed offset",
     "Pixels carry a fixed offset of {pixel_k} rms and columns one of {column_k}"},
    {"fpn_gain", "Fixed gains", "Pixels differ in gain", "Pixels differ in gain by {rms} rms"},
    {"drift", "Drift", "The whole picture drifts slowly with the camera's own temperature",
     "The whole picture drifts by {amplitude_k} over about {time_s}"},
    {"stripes", "Stripes", "Columns or rows get a new offset in each frame",
     "In each frame columns get a new offset of {column_k} and rows one of {row_k}"},
    {"flicker", "Flicker", "The whole frame gets a new offset each time",
     "Each frame as a whole gets a new offset of {sigma_k} rms"},
    {"one_over_f", "1/f noise", "The noise grows towards low frequencies",
     "Below {corner_hz} the noise grows towards low frequencies"},
    {"rts", "Telegraph noise", "Some pixels jump between two levels",
     "{fraction} of the pixels jump by {step_k}, {rate_hz} times a second"},
    {"dead_pixels", "Dead pixels", "Some pixels are stuck or show only noise",
     "{fraction} of the pixels are stuck or show only noise"},
    {"optical_psf", "Optical blur", "The optics blur the picture", "The optics blur the picture by {sigma_px} (sigma)"},
    {"crosstalk", "Crosstalk", "Heat flows between neighbouring pixels",
     "Heat flows between neighbouring pixels, {coupling} of what leaves each"},
    {"radiometric_nonlinearity", "Radiometric nonlinearity",
     "Pixels warm with radiance, not with temperature: rise and fall differ at large contrast", ""},
    {"emissivity", "Emissivity", "The target is no perfect black body and mirrors its surroundings",
     "The target's emissivity is {emissivity}; the rest is its surroundings at {surroundings_k}"},
    {"vignetting", "Vignetting", "Corners receive less than the middle",
     "Corners receive {corner_loss} less than the middle"},
    {"coarse_quantisation", "Coarse quantisation", "Values come in steps coarser than the profile says",
     "Values come in steps of {step_k}"},
    {"saturation", "Saturation", "The hottest values are clipped", "Values are clipped at {level_k}"},
    {"frame_loss", "Lost frames", "Frames are lost or repeated although the counter runs on",
     "{per_thousand} frames in 1,000 are lost or repeated although the counter runs on"},
    {"jitter", "Jitter", "The time at which a frame is sampled varies",
     "The time at which a frame is sampled varies by {rms_s} rms"},
    {"clock_skew", "Clock skew", "The true frame period is not the nominal one",
     "The true frame period is {skew?longer|shorter} than the nominal one by {skew}"},
    {"nuc_freeze", "Shutter freeze", "The camera closed its shutter in between: frozen frames, then new offsets",
     "The camera closed its shutter in between: {freeze_frames} frozen frames, then new offsets of {offset_k}"},
    {"offset_jump", "Offset jump", "At one moment the offset jumps, without a freeze",
     "At one moment the offset jumps by {jump_k}, without a freeze"},
    {"heavy_tail", "Heavy tails", "The noise has more outliers than a Gaussian",
     "The noise has more outliers than a Gaussian: Student's t with {degrees} degrees of freedom"},
    {"noise_level", "Noise level", "The noise is not as strong as the profile says",
     "The noise is {scale~} {scale?stronger|weaker} than the profile says"},
    {"integration_window", "Integration window", "A value is a mean over a part of the frame, not a moment",
     "A value is the mean over {window_s}, not a moment"},
    {"self_heating", "Self-heating", "The read-out heats the pixels, later rows more",
     "The read-out heats the pixels, by up to {amplitude_k} in later rows"},
}};

}  // namespace bolo::diagnose
