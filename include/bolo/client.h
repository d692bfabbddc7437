/* libbolo-client: reads the frames of a running Bolo daemon from its shared memory. C11 and C++.
 *
 *   bolo_client *camera = NULL;
 *   if (bolo_client_open("front", 5000, &camera) != BOLO_CLIENT_OK) { puts(bolo_client_error(NULL)); return 1; }
 *   struct bolo_client_frame frame;
 *   for (;;) {
 *     int result = bolo_client_next(camera, 1000, &frame);
 *     if (result < 0) { puts(bolo_client_error(camera)); break; }
 *     if (result != BOLO_CLIENT_OK) continue;             (no frame in time, or the daemon was restarted)
 *     work_on(frame.deblurred);                           (in place: nothing was copied)
 *     if (!bolo_client_valid(&frame)) discard_the_work(); (the ring had come round meanwhile)
 *   }
 *   bolo_client_close(camera);
 *
 * The ring is mapped read-only: readers, however many, slow, stopped or dead, can neither stop or slow the daemon nor
 * change a frame. A handle outlives the daemon: it waits for the next daemon of the same name, returns
 * BOLO_CLIENT_RESTARTED once, and continues with its frames.
 *
 * Results. 0 is success. Above 0 nothing is wrong, but there is no frame or value. Below 0 is an error, whose cause and
 * remedy bolo_client_error() states in one line. Nothing aborts, and no exception leaves.
 *
 * Threads. One thread at a time may use a handle; any number of handles work side by side. "Any thread": no such limit.
 *
 * Times are nanoseconds of CLOCK_MONOTONIC unless stated otherwise. timeout_ms: 0 polls once, below 0 waits forever.
 *
 * Planes are row-major uint16, width * height of them: kelvin = scale * value + offset, or counts; see
 * bolo_client_kelvin(). bolo/shm_layout.h describes the shared memory itself.
 *
 * A daemon's segment is trusted only if it belongs to root, to the reader's own user, to "bolo" (the user of the
 * packaged daemon) or to the user that the environment variable BOLO_USER names or numbers, because anybody can create
 * a segment of any name. Then its header is checked. Only its owner could still shrink it, which would end its readers
 * with SIGBUS; Bolo never does.
 *
 * Compatibility. Structures grow only at their end or in `reserved`, and are filled or owned by the library, so a
 * program works with every later libbolo-client.so.0.
 */
#ifndef BOLO_CLIENT_H
#define BOLO_CLIENT_H

#include <stddef.h>
#include <stdint.h>

#include "bolo/shm_layout.h"

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define BOLO_CLIENT_API __attribute__((visibility("default")))
#else
#define BOLO_CLIENT_API
#endif

/* Names as C has them. NOLINTBEGIN(readability-identifier-naming,modernize-*) */

enum bolo_client_result {
  BOLO_CLIENT_OK = 0,
  BOLO_CLIENT_TIMEOUT = 1,   /* the daemon lives, but published nothing in time */
  BOLO_CLIENT_RESTARTED = 2, /* another daemon writes now: see bolo_client_next() */
  BOLO_CLIENT_ENDED = 3,     /* the daemon ended or stalled, and none replaced it in time; call again to keep waiting */
  BOLO_CLIENT_OVERWRITTEN = 4, /* the frame, or one of its window, has left the ring */
  BOLO_CLIENT_NOT_YET = 5,     /* the frame's look-ahead is not published */
  BOLO_CLIENT_WARM_UP = 6,     /* the frame had no full window: its deblurred plane is the raw one */
  BOLO_CLIENT_NO_MOTION = 7,   /* the scene's motion is not known for this frame, or this daemon does not estimate it */

  BOLO_CLIENT_ABSENT = -1,     /* there is no such stream: is the daemon running? */
  BOLO_CLIENT_DENIED = -2,     /* this user may not read it, or must not trust it: see above */
  BOLO_CLIENT_BAD_STREAM = -3, /* of another version, or damaged */
  BOLO_CLIENT_BAD_ARGUMENT = -4,
  BOLO_CLIENT_UNSUPPORTED = -5, /* not supported by this stream */
  BOLO_CLIENT_FAILED = -6       /* the system refused: no memory, no descriptors ... */
};

/* A stream, followed across restarts of its daemon. */
typedef struct bolo_client bolo_client;

/* Properties of a stream. Owned by its handle, which updates it at each BOLO_CLIENT_RESTARTED. frame_period_s is that
 * of the newest frame given: the daemon corrects it where the camera's clock differs from its settings. */
struct bolo_client_info {
  uint32_t width;  /* pixels */
  uint32_t height; /* pixels */
  uint32_t unit;   /* enum bolo_shm_unit */
  uint32_t row_step;
  double scale;          /* kelvin = scale * value + offset where unit is BOLO_UNIT_KELVIN */
  double offset;         /* kelvin */
  double frame_period_s; /* used by the solver */
  double tau_s;          /* time constant that is undone */
  uint32_t window;       /* frames that one frame is estimated from */
  uint32_t lookahead;    /* of these, after the estimated frame: its publication is delayed by as many frames */
  uint32_t slot_count;   /* frames in the ring: slot_count * frame_period_s is how long a frame stays */
  uint32_t writer_pid;   /* in the daemon's own PID namespace */
  int64_t start_ns;      /* when the daemon made this stream */
  uint64_t restarts;     /* daemons that this handle has followed after its first one */
  const char* camera_model;
  const char* camera_serial;
  const char* solver;                       /* description */
  const struct bolo_shm_settings* settings; /* of the solver; NULL: not published by the daemon */
  const char* control_socket;               /* path of the daemon's control socket; "": none */
  double row_delay_s;                       /* sensor row r is sampled r * row_delay_s after the frame's time */
};

/* A frame in the ring. Filled by bolo_client_next() and bolo_client_latest(). */
struct bolo_client_frame {
  uint64_t number;             /* publication order of this daemon, from 0 */
  uint64_t missed;             /* frames published since the last one given that this handle skipped */
  uint64_t frame_id;           /* the camera's counter; a jump is a frame lost before the daemon */
  int64_t camera_ns;           /* the camera's clock */
  int64_t host_ns;             /* camera_ns on the host's clock: when the camera took it; 0: not known */
  int64_t receive_ns;          /* first byte received */
  int64_t publish_ns;          /* put into the ring */
  double noise_k;              /* noise that it was solved with, kelvin (or counts); 0: not used */
  uint32_t flags;              /* enum bolo_shm_flag */
  uint32_t width;              /* pixels */
  uint32_t height;             /* pixels */
  uint32_t utc_uncertainty_us; /* bound of the error of utc_ns, us; 16,000,000 and more: unbounded */
  const uint16_t* raw;         /* as the camera gave it */
  const uint16_t* deblurred;   /* with the pixels' thermal inertia undone */
  const void* slot;            /* private to the library */
  /* Motion of the scene from the frame before to this one; NULL and 0 where the daemon's solver does not estimate it
   * (only "motion" does) or could not. Read in place, like the planes: check bolo_client_valid() afterwards. */
  const struct bolo_shm_motion* motion;              /* of the whole picture */
  const struct bolo_shm_block_motion* motion_blocks; /* of 8x8 pixels each, row-major: motion_across * motion_down */
  uint32_t motion_across;
  uint32_t motion_down;
  int64_t utc_ns; /* host_ns (receive_ns where that is 0) in UTC: ns since 1970; 0: not known */
};

/* State of daemon and camera. Owned by the handle, as of the last bolo_client_get_state(). */
struct bolo_client_state {
  uint32_t alive;              /* 0: the daemon ended, or had no heartbeat for BOLO_SHM_STALE_NS */
  uint32_t clock_synchronised; /* 1: the host's clock is disciplined, according to its kernel */
  int64_t heartbeat_age_ns;
  uint64_t published;                   /* frames */
  uint64_t received;                    /* whole frames from the camera */
  uint64_t restarts;                    /* windows emptied: NUC, long gaps, reconnects */
  uint64_t warm_up;                     /* frames published without a full window */
  uint64_t gap_frames;                  /* frames with a lost one in their window */
  uint64_t lost_frames;                 /* before publication, all causes */
  uint64_t lost[BOLO_SHM_LOSS_CAUSES];  /* by cause, as in struct bolo_shm_header */
  const struct bolo_shm_camera* camera; /* NULL: not published by the daemon */
  int64_t clock_error_ns;               /* bound of the error of the host's UTC; 16 s: unbounded */
  uint64_t clock_steps;                 /* times the host's clock was set */
};

struct bolo_client_point {
  uint32_t x; /* column, from 0 */
  uint32_t y; /* row, from 0 */
};

/* Version of the library in use, "0.1.0". Any thread. */
BOLO_CLIENT_API const char* bolo_client_version(void);

/* Names of the existing streams, sorted, one per line; those of dead daemons included. Writes at most `bytes`, the
 * terminating zero included, and returns the bytes that the whole text needs, or an error. Any thread. */
BOLO_CLIENT_API int bolo_client_streams(char* text, size_t bytes);

/* Opens the stream "front" of a daemon with [shm] name = "front", waiting up to timeout_ms for it. *client is NULL
 * after an error: ABSENT, DENIED, BAD_STREAM, BAD_ARGUMENT, FAILED. The newest frame is given first. Any thread. */
BOLO_CLIENT_API int bolo_client_open(const char* name, int timeout_ms, bolo_client** client);

/* Frees the handle; NULL is allowed. Its frames become invalid, except those under bolo_client_hold_new(). */
BOLO_CLIENT_API void bolo_client_close(bolo_client* client);

/* The handle's last error in one line, or what prevents frames after BOLO_CLIENT_ENDED; for client NULL, the error of
 * this thread's last call without a handle. Valid until the next call. */
BOLO_CLIENT_API const char* bolo_client_error(const bolo_client* client);

/* Properties of the stream. Never NULL; good until BOLO_CLIENT_RESTARTED or close. */
BOLO_CLIENT_API const struct bolo_client_info* bolo_client_get_info(const bolo_client* client);

/* Present state of daemon and camera. Never NULL; good until the next call of this function, or close. */
BOLO_CLIENT_API const struct bolo_client_state* bolo_client_get_state(bolo_client* client);

/* Waits for the next frame in order. Where frames were overwritten before this handle read them, it skips to the middle
 * of the ring and counts them in frame->missed.
 *
 * OK, TIMEOUT, ENDED. RESTARTED: another daemon has taken the name, and the old ring is read out. info is filled anew:
 * check that its geometry and scale still suit you, then call again. Frame numbers start at 0 again; earlier frames and
 * their pointers are invalid, except those under bolo_client_hold_new(). */
BOLO_CLIENT_API int bolo_client_next(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame);

/* As bolo_client_next(), but gives the newest frame not given yet; the frames skipped count as missed. */
BOLO_CLIENT_API int bolo_client_latest(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame);

/* 1 if everything read from the planes before this call belonged to the frame; 0 if the daemon has begun to overwrite
 * them: discard what was computed since the last 1. Any thread. */
BOLO_CLIENT_API int bolo_client_valid(const struct bolo_client_frame* frame);

/* Copies width * height values a plane; NULL skips one. OK; OVERWRITTEN: invalid copy; BAD_ARGUMENT. Any thread. */
BOLO_CLIENT_API int bolo_client_copy(const struct bolo_client_frame* frame, uint16_t* raw, uint16_t* deblurred);

/* Copies the frame's motion: of the whole picture and of its motion_across * motion_down blocks; NULL skips one. OK;
 * NO_MOTION: it has none; OVERWRITTEN: the copy is invalid; BAD_ARGUMENT. Any thread. */
BOLO_CLIENT_API int bolo_client_copy_motion(const struct bolo_client_frame* frame, struct bolo_shm_motion* motion,
                                            struct bolo_shm_block_motion* blocks);

/* Converts values of this stream's planes to kelvin. UNSUPPORTED: the stream is in counts. */
BOLO_CLIENT_API int bolo_client_kelvin(bolo_client* client, const uint16_t* values, size_t count, float* kelvin);

/* Solves `count` points of frame `number` in this process, from the raw planes in the ring: bit for bit the values of
 * the deblurred plane. Kelvin, or counts where info->unit is BOLO_UNIT_COUNT.
 *
 * The newest frame that can be solved is state->published - 1 - info->lookahead.
 * OK, NOT_YET, OVERWRITTEN, WARM_UP (nothing is written to `values` then); BAD_ARGUMENT: a point outside the frame;
 * UNSUPPORTED: pixels of this stream have parameters of their own, or are changed around the solver: read the deblurred
 * plane instead. Points that stay the same from call to call are fastest. */
BOLO_CLIENT_API int bolo_client_points(bolo_client* client, uint64_t number, const struct bolo_client_point* points,
                                       size_t count, float* values);

/* Keeps the present ring mapped, and all pointers into it valid, until released: across restarts and close. Its frames
 * may still be overwritten while its daemon lives. NULL when there is no memory. */
typedef struct bolo_client_hold bolo_client_hold;
BOLO_CLIENT_API bolo_client_hold* bolo_client_hold_new(const bolo_client* client);

/* NULL is allowed. Any thread. */
BOLO_CLIENT_API void bolo_client_hold_free(bolo_client_hold* hold);

/* NOLINTEND(readability-identifier-naming,modernize-*) */

#ifdef __cplusplus
}
#endif

#endif /* BOLO_CLIENT_H */
