/* The layout of Bolo's shared memory: POSIX object "/bolo.NAME", mapped read-only by readers. C11 and C++.
 *
 *   offset 0                       struct bolo_shm_header
 *   header.settings_offset         struct bolo_shm_settings    (0: not published)
 *   settings.camera_offset         struct bolo_shm_camera      (0: not published)
 *   header.slots_offset            slot 0: struct bolo_shm_slot, raw plane, deblurred plane, motion, padding
 *   + header.slot_stride           slot 1 ...                 (header.slot_count slots)
 *
 * The motion of the scene lies in the slots if header.motion_offset is not 0 (solver "motion"): struct bolo_shm_motion,
 * then header.motion_across * motion_down of struct bolo_shm_block_motion, row-major. It belongs to the slot's frame,
 * and is written and read with its planes, if the slot's motion_blocks is that number; 0: not known for the frame.
 *
 * All values little-endian, as the machine stores them. Planes are row-major uint16 without padding between rows;
 * kelvin = scale * value + offset when unit is BOLO_UNIT_KELVIN.
 *
 * Frame number n (0, 1, 2 ...: publication order, not the camera's frame id) lies in slot n % slot_count.
 * header.published counts published frames: the newest is published - 1. Counters and latencies are stored before it,
 * so a reader that loads it first (acquire) finds them at least as new.
 *
 * Reading frame n without locks (tests/models tries every order of it). The writer never waits:
 *
 *   writer                                             reader
 *   ------                                             ------
 *   W1 slot.sequence = 2n + 1      (relaxed)           R1 s = slot.sequence      (acquire)   <-- pairs W3
 *   W2 every word of the slot      (release)           R2 copy every word        (acquire)   <-- pairs W2
 *   W3 slot.sequence = 2n + 2      (release)           R3 slot.sequence == s, s == 2n + 2 ? good : overwritten
 *   W4 header.published = n + 1    (release)
 *   W5 header.wake += 1, futex wake
 *
 * A reader that copied any word of a later frame m in R2 has, by that acquire, W1 of m before its R3: it sees an odd or
 * higher sequence there and discards the copy. On x86-64 acquire and release of 64-bit words cost nothing.
 *
 * To wait for a frame: read header.wake, check published, and FUTEX_WAIT (shared, not private) on header.wake with the
 * value read, for about a frame period at most: any process that maps the object can requeue its waiters onto its own
 * futex, where nobody wakes them. A process that can't use futexes polls published.
 *
 * A writer that ends in order stores BOLO_SHM_CLOSED in header.state and unlinks the name. A writer that starts under
 * the name of a dead writer unlinks the old object. So a reader that gets no new frames checks whether the name now
 * belongs to another object (stat: its inode), and maps that. The object is never resized while it has a name.
 *
 * Solving a pixel on demand. Frame n was estimated from the raw planes of its window, which ends lookahead frames after
 * n and holds at most `window` frames: those that the window's rules (camera_ns, frame_id, frame_period_s) place there.
 * A reader that solves a pixel's samples in them with bolo_shm_settings gets the deblurred plane's bits
 * (drivers/shm/point_reader.hpp does), or better ones where the slot's flags show less effort. Not possible with
 * BOLO_SETTINGS_UNDONE. With BOLO_SETTINGS_MAPS the reader also needs the same maps file, which is not in the shared
 * memory. For BOLO_METHOD_MMAE, BOLO_METHOD_MOTION and BOLO_SETTINGS_AUTO_LAMBDA it needs whole planes and the slot's
 * noise_k, because these use a pixel's surroundings. (BOLO_METHOD_MOTION with measured noise is equal to a count:
 * motions are found with the noise of their own frames.)
 *
 * The writer holds flock(LOCK_EX) on /dev/shm/bolo-lock.NAME while it lives, so that a second writer of the same name
 * is refused, whatever its process namespace. Only the writer's user can open that file: a reader's lock would keep the
 * next writer out. Readers take no lock.
 *
 * Anybody can create a file of any name in /dev/shm: a reader checks its owner (fstat) before trusting it.
 *
 * For readers in other languages, the header's bytes (Python: struct.unpack_from of the first 312, then the rest live):
 *   "<QIIIIIIQQQQddddIIII64s64s64sq"  magic .. start_ns        at   0
 *   "<Q"                              settings_offset          at 312
 *   "<QIIQQQQQQ16Q192Q"               published .. latency     at 320
 *   "<QIIdQqQ"                        motion_offset ..         at 2048  (2,112 bytes in all)
 * and a slot's: "<QQqqqIIdqqq" at 0, 128 bytes, then the planes at raw_offset and deblurred_offset, and at
 * motion_offset "<6d", from byte 64 of it on "<3f" for each block.
 *
 * Times. camera_ns is the camera's own clock, host_ns and receive_ns the host's CLOCK_MONOTONIC, utc_ns the same moment
 * in UTC. Monotonic and camera times never step; utc_ns steps when the host's clock is set: header.clock_steps counts
 * that. In all of them, sensor row r (stored row r / row_step) is sampled r * header.row_delay_s after the frame.
 *
 * Versions. A reader accepts only its own. 3 added UTC, row_delay_s and slots of 128 bytes before their planes; 2 added
 * motion; 1 had a header of 2,048 bytes.
 */
#ifndef BOLO_SHM_LAYOUT_H
#define BOLO_SHM_LAYOUT_H

#include <stddef.h>
#include <stdint.h>

#define BOLO_SHM_MAGIC 0x4d48534f4c4f42ULL /* "BOLOSHM" */
#define BOLO_SHM_VERSION 3u
#define BOLO_SHM_LOSS_CAUSES 16u
#define BOLO_SHM_LATENCY_BUCKETS 192u
#define BOLO_SHM_STALE_NS 2000000000LL /* an older heartbeat belongs to a dead or stopped writer */

/* Names as C has them. NOLINTBEGIN(readability-identifier-naming) */
enum bolo_shm_state { BOLO_SHM_STARTING = 0, BOLO_SHM_RUNNING = 1, BOLO_SHM_CLOSED = 2 };
enum bolo_shm_unit { BOLO_UNIT_KELVIN = 0, BOLO_UNIT_COUNT = 1 };

enum bolo_shm_flag {
  BOLO_FLAG_GAP = 1u << 0,       /* a frame of this frame's window was lost */
  BOLO_FLAG_WARM_UP = 1u << 1,   /* no full window yet: the deblurred plane is the raw one */
  BOLO_FLAG_NUC = 1u << 2,       /* the camera was correcting (NUC, shutter closed) */
  BOLO_FLAG_SATURATED = 1u << 3, /* raw values at the end of the range */
  BOLO_FLAG_JITTER = 1u << 4,    /* camera timestamp off the frame grid */
  /* Less effort was spent on this frame because too many were waiting; at most one of these: */
  BOLO_FLAG_REDUCED = 1u << 5, /* cheaper solver */
  BOLO_FLAG_INVERSE = 1u << 6, /* inverse filter, without a prior: noisier */
  BOLO_FLAG_RAW = 1u << 7      /* no solver: the deblurred plane is the raw one */
};

struct bolo_shm_header {
  uint64_t magic;
  uint32_t version;
  uint32_t header_bytes; /* sizeof(struct bolo_shm_header) of the writer */

  uint32_t width;
  uint32_t height;
  uint32_t slot_count; /* at least a window, so that readers can solve any pixel on demand */
  uint32_t unit;       /* enum bolo_shm_unit */
  uint64_t slots_offset;
  uint64_t slot_stride;
  uint64_t raw_offset;       /* from the slot's start */
  uint64_t deblurred_offset; /* from the slot's start */
  double scale;              /* kelvin a count */
  double offset;             /* kelvin */
  double frame_period_s; /* used by the solver. Live: corrected if the camera's clock differs from its stated period */
  double tau_s;
  uint32_t window;    /* frames a window */
  uint32_t lookahead; /* frames */
  uint32_t row_step;  /* sensor rows a stored row stands for */
  uint32_t writer_pid;
  char camera_model[64];
  char camera_serial[64];
  char solver[64];  /* method, iterations, lambda, instruction set as text; truncated to fit, like other texts */
  int64_t start_ns; /* CLOCK_MONOTONIC, when the writer made the object */
  uint64_t settings_offset; /* of struct bolo_shm_settings, between header and slots; 0: none */

  /* Written while running. 64-byte aligned from here. */
  uint64_t published __attribute__((aligned(64)));
  uint32_t wake;         /* futex word: changes with every published frame */
  uint32_t state;        /* enum bolo_shm_state */
  uint64_t heartbeat_ns; /* CLOCK_MONOTONIC of the writer's heartbeat; at least every 250 ms while running */

  uint64_t received; /* complete frames from the camera */
  uint64_t restarts; /* windows emptied */
  uint64_t warm_up;
  uint64_t gap_frames;
  uint64_t deblur_ns;                  /* summed over published frames */
  uint64_t lost[BOLO_SHM_LOSS_CAUSES]; /* by cause: incomplete, missing, pool_exhausted, queue_full, bad_frame, driver,
                                          out_of_order */
  uint64_t latency[BOLO_SHM_LATENCY_BUCKETS]; /* receive -> publish. Bucket b < 8: b us. Else, with e = b / 8 and
                                                 m = b % 8: from (8 + m) << (e - 1) to (9 + m) << (e - 1) us */

  /* Written before magic, never changed. 64-byte aligned from here. */
  uint64_t motion_offset __attribute__((aligned(64))); /* of struct bolo_shm_motion from the slot's start; 0: none */
  uint32_t motion_across;                              /* blocks of 8x8 pixels: (width + 7) / 8; 0: none */
  uint32_t motion_down;
  double row_delay_s; /* from the sample of one sensor row to that of the next; 0: all at once, or not known */

  /* Written while running. */
  uint64_t clock_synchronised; /* 1: the host's clock is disciplined, according to the kernel */
  int64_t clock_error_ns;      /* bound of the error of the host's UTC, as the kernel knows it; 16 s: unbounded */
  uint64_t clock_steps;        /* times the host's clock was set */
  uint64_t reserved[2];
};

struct bolo_shm_slot {
  uint64_t sequence; /* odd while written; 2n + 2 when it holds frame n */
  uint64_t frame_id;
  int64_t camera_ns;
  int64_t receive_ns;     /* CLOCK_MONOTONIC, first byte received */
  int64_t publish_ns;     /* CLOCK_MONOTONIC */
  uint32_t flags;         /* enum bolo_shm_flag */
  uint32_t motion_blocks; /* motion_across * motion_down; 0: the scene's motion is not known for this frame */
  double noise_k;         /* temporal noise that the frame was solved with, K (counts without kelvin); 0: not used */
  int64_t host_ns; /* camera_ns on the host's CLOCK_MONOTONIC: when the camera took the frame; 0: not known. Its error
                      is the shortest latency from camera to host: constant, and well below a frame period */
  int64_t utc_ns;  /* host_ns in UTC, or receive_ns where that is not known: ns since 1970; 0: not known */
  int64_t utc_uncertainty_ns; /* bound of the error of utc_ns: the host clock's error as the kernel knows it, plus that
                                 of host_ns: the latency from camera to host, a frame period and its jitter. 16 s and
                                 more: the host's clock is not disciplined, and its error unbounded */
  uint64_t reserved[6];
};

/* Motion of the scene through the picture from the frame before to this one: px a frame, to the right and down. */
struct bolo_shm_motion {
  double affine[6]; /* of the whole picture: x = a0 + a1 X + a2 Y, y = a3 + a4 X + a5 Y, at X columns and Y rows from
                       the frame's centre, column (width - 1) / 2 and row (height - 1) / 2 */
  uint64_t reserved[2];
};

/* Of 8x8 pixels, the last ones of a row or column fewer. */
struct bolo_shm_block_motion {
  float x; /* px a frame */
  float y;
  float confidence; /* 0 (unknown: x and y are the whole picture's) to 1: 1 / (1 + (s / 0.25 px)^2), s the standard
                       error of the velocity, and less where the two frames do not match */
};

enum bolo_shm_method {
  BOLO_METHOD_ADMM = 0,
  BOLO_METHOD_DUAL = 1,
  BOLO_METHOD_EXACT = 2,
  BOLO_METHOD_INVERSE = 3,
  BOLO_METHOD_MMAE = 4,
  BOLO_METHOD_MOTION = 5
};

enum bolo_shm_settings_flag {
  BOLO_SETTINGS_AUTO_LAMBDA = 1u << 0, /* lambda is chosen from noise and motion */
  BOLO_SETTINGS_MAPS = 1u << 1,        /* pixels or rows have parameters of their own, which are not here */
  BOLO_SETTINGS_UNDONE = 1u << 2       /* corrections act before or after the solver: raw planes are not its input */
};

/* Settings of the solver, besides tau_s, frame_period_s, window, lookahead and scale of the header. Written before
 * magic, never changed. As configured: 0 iterations means as many as the accuracy needs. */
struct bolo_shm_settings {
  uint32_t bytes;  /* sizeof(struct bolo_shm_settings) of the writer */
  uint32_t method; /* enum bolo_shm_method */
  uint32_t flags;  /* enum bolo_shm_settings_flag */
  uint32_t levels;
  uint32_t iterations;
  uint32_t camera_offset; /* of struct bolo_shm_camera, before the slots; 0: none */
  double kappa;
  double lambda;
  double noise_k; /* given; 0: measured */
  char isa[16];   /* instruction set of the kernels: other sets round differently */
};

enum bolo_shm_camera_state {
  BOLO_CAMERA_IDLE = 0,      /* no camera, or not watched: a capture is replayed */
  BOLO_CAMERA_STREAMING = 1, /* frames arrive */
  BOLO_CAMERA_STALLED = 2,   /* connected, but frames have stopped */
  BOLO_CAMERA_LOST = 3,      /* being reopened */
  BOLO_CAMERA_CORRECTING = 4 /* shutter closed: NUC */
};

#define BOLO_SHM_LOST_CAUSES 8u

/* State of the writer's camera. Live: each word is written by itself while running, with every frame and at least every
 * 250 ms without frames. Times are CLOCK_MONOTONIC, counts are since the writer's start. */
struct bolo_shm_camera {
  uint64_t bytes;                      /* sizeof(struct bolo_shm_camera) of the writer */
  uint64_t state;                      /* enum bolo_shm_camera_state */
  int64_t since_ns;                    /* start of this state */
  uint64_t lost[BOLO_SHM_LOST_CAUSES]; /* times it was given up: control lost, no answer, stalled */
  uint64_t reopened;
  uint64_t stalls;
  uint64_t outage_frames;  /* frames that it would have sent while lost; not among header.lost */
  uint64_t corrections;    /* NUCs requested */
  int64_t correction_ns;   /* the last one; 0: none */
  int64_t clock_offset_ns; /* host's clock - camera's; 0: not known yet */
  double clock_drift_ppm;  /* positive: the camera's clock is slower */
  double clock_jitter_ns;  /* of the latency from camera to host, rms above its shortest */
  uint64_t clock_jumps;
  uint64_t received_packets;
  uint64_t missing_packets;
  uint64_t resent_packets;
  double temperature_k;     /* of the camera; 0: unknown */
  char control_socket[112]; /* path of the writer's control socket; empty: none. Written before magic, never changed */
  uint64_t ptp;             /* port state of its PTP clock, numbered as in IEEE 1588 (9: slave); 0: off, or unknown */
  int64_t ptp_offset_ns;    /* of its clock from its PTP master, by its own estimate */
};

/* sizeof(struct bolo_shm_camera) in writers before `ptp`. */
#define BOLO_SHM_CAMERA_BYTES_FIRST 304u

#ifdef __cplusplus
#define BOLO_SHM_ASSERT(condition) static_assert(condition, "the layout is a contract with other programs")
#else
#define BOLO_SHM_ASSERT(condition) _Static_assert(condition, "the layout is a contract with other programs")
#endif
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_slot) == 128);
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_header) == 2112);
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_motion) == 64);
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_block_motion) == 12);
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_settings) == 64);
BOLO_SHM_ASSERT(sizeof(struct bolo_shm_camera) == 320);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, width) == 16);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, slots_offset) == 32);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, scale) == 64);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, window) == 96);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, camera_model) == 112);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, start_ns) == 304);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, settings_offset) == 312);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, published) == 320);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, wake) == 328);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, heartbeat_ns) == 336);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, lost) == 384);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, latency) == 512);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, motion_offset) == 2048);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_slot, flags) == 40);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_slot, noise_k) == 48);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_slot, host_ns) == 56);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_slot, utc_ns) == 64);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_slot, utc_uncertainty_ns) == 72);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, row_delay_s) == 2064);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_header, clock_synchronised) == 2072);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_settings, camera_offset) == 20);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_camera, reopened) == 88);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_camera, control_socket) == 192);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_settings, kappa) == 24);
BOLO_SHM_ASSERT(offsetof(struct bolo_shm_settings, isa) == 48);

/* NOLINTEND(readability-identifier-naming) */

#endif /* BOLO_SHM_LAYOUT_H */
