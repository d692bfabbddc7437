/* Frames of a running Bolo daemon, out of its shared memory, for other programs: libbolo-client. C11 and C++.
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
 * A daemon's ring is mapped read-only: no reader can stop it, slow it or change a frame, however many there are, and
 * whether they are slow, stand still or die. A handle outlives the daemon: it waits for the next one under the same
 * name, returns BOLO_CLIENT_RESTARTED once, and goes on with its frames.
 *
 * Results. 0 is success. Above 0 nothing is wrong, but there is no frame or value. Below 0 is an error, and
 * bolo_client_error() describes the fault and its remedy in one line. Nothing aborts, and no exception leaves.
 *
 * Threads. One handle is for one thread at a time; any number of handles can be used side by side. What is documented
 * as "any thread" takes no handle, or does not mind.
 *
 * Times are nanoseconds of CLOCK_MONOTONIC unless stated otherwise. timeout_ms: 0 only polls, below 0 waits as long as
 * it takes.
 *
 * Planes are row-major uint16, width * height of them: kelvin = scale * value + offset, or counts; see
 * bolo_client_kelvin(). What lies in the shared memory itself is in bolo/shm_layout.h.
 *
 * A daemon's segment is trusted only if it belongs to root, to the reader's own user, to "bolo", as which the packaged
 * daemon runs, or to the user that the environment's BOLO_USER names or numbers: anybody may make one of any name. Then
 * its header is checked. Only the user that owns it could still shrink it under its readers, which would end them with
 * SIGBUS; Bolo never does.
 *
 * Compatible: structures grow at their end or in `reserved` only, and are filled or owned by the library, so a program
 * goes on with every later libbolo-client.so.0.
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
  BOLO_CLIENT_TIMEOUT = 1,     /* the daemon lives, but published nothing in time */
  BOLO_CLIENT_RESTARTED = 2,   /* another daemon writes now: see bolo_client_next() */
  BOLO_CLIENT_ENDED = 3,       /* the daemon ended or stands still, and no other came in time; call again to wait on */
  BOLO_CLIENT_OVERWRITTEN = 4, /* the frame, or one of its window, has left the ring */
  BOLO_CLIENT_NOT_YET = 5,     /* the frame's look-ahead is not published */
  BOLO_CLIENT_WARM_UP = 6,     /* the frame had no full window: its deblurred plane is the raw one */
  BOLO_CLIENT_NO_MOTION = 7,   /* the scene's motion is not known for this frame, or this daemon does not estimate it */

  BOLO_CLIENT_ABSENT = -1,       /* there is no such stream: is the daemon running? */
  BOLO_CLIENT_DENIED = -2,       /* this user may not read it, or should not trust it: see below */
  BOLO_CLIENT_BAD_STREAM = -3,   /* of another version, or damaged */
  BOLO_CLIENT_BAD_ARGUMENT = -4, /* of this call */
  BOLO_CLIENT_UNSUPPORTED = -5,  /* this stream can't do that */
  BOLO_CLIENT_FAILED = -6        /* the system refused: no memory, no descriptors ... */
};

/* A stream, followed across restarts of its daemon. */
typedef struct bolo_client bolo_client;

/* Properties of a stream. Owned by its handle, which fills it anew at each BOLO_CLIENT_RESTARTED; the period is that of
 * the newest frame given: the daemon finds another one where the camera's clock differs from its settings. */
struct bolo_client_info {
  uint32_t width;  /* pixels */
  uint32_t height; /* pixels */
  uint32_t unit;   /* enum bolo_shm_unit */
  uint32_t row_step;
  double scale;          /* kelvin = scale * value + offset where unit is BOLO_UNIT_KELVIN */
  double offset;         /* kelvin */
  double frame_period_s; /* that frames are solved with */
  double tau_s;          /* time constant that is undone */
  uint32_t window;       /* frames that one frame is estimated from */
  uint32_t lookahead;    /* of them after the frame: how much later than its raw plane a frame is published */
  uint32_t slot_count;   /* frames in the ring: slot_count * frame_period_s is how long a frame stays */
  uint32_t writer_pid;   /* as the daemon sees itself; another one in a container */
  int64_t start_ns;      /* when the daemon made this stream */
  uint64_t restarts;     /* daemons that this handle has followed after its first one */
  const char* camera_model;
  const char* camera_serial;
  const char* solver;                       /* in words */
  const struct bolo_shm_settings* settings; /* of the solver; NULL: not published by the daemon */
  const char* control_socket;               /* path of the daemon's control socket; "": none */
  double row_delay_s;                       /* sensor row r is sampled r * row_delay_s after the frame's time */
};

/* A frame in the ring. Filled by bolo_client_next() and bolo_client_latest(). */
struct bolo_client_frame {
  uint64_t number;    /* publication order of this daemon, from 0 */
  uint64_t missed;    /* frames published between this and the one given before it that this handle did not give */
  uint64_t frame_id;  /* the camera's counter; a jump is a frame lost before the daemon */
  int64_t camera_ns;  /* the camera's clock */
  int64_t host_ns;    /* camera_ns on the host's clock: when the camera took it; 0: not known */
  int64_t receive_ns; /* first byte received */
  int64_t publish_ns; /* put into the ring */
  double noise_k;     /* noise that it was solved with, kelvin (or counts); 0: not used */
  uint32_t flags;     /* enum bolo_shm_flag */
  uint32_t width;     /* pixels */
  uint32_t height;    /* pixels */
  uint32_t utc_uncertainty_us; /* of utc_ns, at most, in microseconds; 16,000,000 and more: nothing bounds it */
  const uint16_t* raw;         /* as the camera gave it */
  const uint16_t* deblurred;   /* with the pixels' inertia undone */
  const void* slot;            /* the library's */
  /* Motion of the scene from the frame before to this one, where the daemon's solver estimates it ("motion") and could
   * for this frame; else NULL and 0. In place, as the planes: counts if bolo_client_valid() holds afterwards. */
  const struct bolo_shm_motion* motion;              /* of the whole picture */
  const struct bolo_shm_block_motion* motion_blocks; /* of 8x8 pixels each, row-major: motion_across * motion_down */
  uint32_t motion_across;
  uint32_t motion_down;
  int64_t utc_ns; /* host_ns (receive_ns where that is 0) in UTC: ns since 1970; 0: not known */
};

/* State of daemon and camera. Owned by the handle, as of the last bolo_client_get_state(). */
struct bolo_client_state {
  uint32_t alive;              /* 0: the daemon ended, or gave no sign of life for BOLO_SHM_STALE_NS */
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
  int64_t clock_error_ns;               /* of the host's UTC, at most; 16 s: nothing bounds it */
  uint64_t clock_steps;                 /* times that somebody set it */
};

struct bolo_client_point {
  uint32_t x; /* column, from 0 */
  uint32_t y; /* row, from 0 */
};

/* Version of the library in use, "0.1.0". Any thread. */
BOLO_CLIENT_API const char* bolo_client_version(void);

/* The names of the streams that exist now, each on a line of its own, sorted; of dead daemons too. Writes at most
 * `bytes` with the ending zero, and returns the bytes that all of it takes, or an error. Any thread. */
BOLO_CLIENT_API int bolo_client_streams(char* text, size_t bytes);

/* Opens the stream "front" of a daemon with [shm] name = "front", waiting up to timeout_ms for it to be there and
 * readable. *client is NULL after an error: ABSENT, DENIED, BAD_STREAM, BAD_ARGUMENT, FAILED. The first frame given is
 * the newest. Any thread. */
BOLO_CLIENT_API int bolo_client_open(const char* name, int timeout_ms, bolo_client** client);

/* Frees the handle; NULL is fine. Frames that it gave are gone, but those under bolo_client_hold(). */
BOLO_CLIENT_API void bolo_client_close(bolo_client* client);

/* One line on the last error of this handle, or on what stands in the way after BOLO_CLIENT_ENDED; of this thread's
 * last call without a handle where client is NULL. Good until the next call. */
BOLO_CLIENT_API const char* bolo_client_error(const bolo_client* client);

/* Properties of the stream. Never NULL; good until BOLO_CLIENT_RESTARTED or close. */
BOLO_CLIENT_API const struct bolo_client_info* bolo_client_get_info(const bolo_client* client);

/* Present state of daemon and camera. Never NULL; good until the next call of this function, or close. */
BOLO_CLIENT_API const struct bolo_client_state* bolo_client_get_state(bolo_client* client);

/* Waits for the next frame in order. Frames that were overwritten before this handle came to them are skipped, to the
 * middle of the ring, and counted in frame->missed.
 *
 * OK, TIMEOUT, ENDED; RESTARTED: another daemon has taken the name, all that is still in the old ring was given, and
 * info is filled anew: check that its geometry and scale still suit you, then call again. Frames count from 0 again.
 * Frames given before, and their pointers, are gone then, but those under bolo_client_hold(). */
BOLO_CLIENT_API int bolo_client_next(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame);

/* The same with the newest frame that this handle has not given yet; those before it count as missed. */
BOLO_CLIENT_API int bolo_client_latest(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame);

/* 1 when the planes were the frame's during all that was read of them before this call; 0 when the daemon has begun to
 * overwrite them: what was made of them since the last 1 is to be thrown away. Any thread. */
BOLO_CLIENT_API int bolo_client_valid(const struct bolo_client_frame* frame);

/* Copies width * height values of each plane; NULL leaves one out. OK; OVERWRITTEN: what was copied is worthless;
 * BAD_ARGUMENT. Any thread. */
BOLO_CLIENT_API int bolo_client_copy(const struct bolo_client_frame* frame, uint16_t* raw, uint16_t* deblurred);

/* Copies the frame's motion: of the whole picture and of its motion_across * motion_down blocks; NULL leaves one out.
 * OK; NO_MOTION: it has none; OVERWRITTEN: what was copied is worthless; BAD_ARGUMENT. Any thread. */
BOLO_CLIENT_API int bolo_client_copy_motion(const struct bolo_client_frame* frame, struct bolo_shm_motion* motion,
                                            struct bolo_shm_block_motion* blocks);

/* Values of a plane of this stream to kelvin. UNSUPPORTED: it is in counts. */
BOLO_CLIENT_API int bolo_client_kelvin(bolo_client* client, const uint16_t* values, size_t count, float* kelvin);

/* Solves `count` points of frame `number` from the raw planes in the ring, here, in this process: bit for bit what the
 * deblurred plane holds there. Kelvin, or counts where info->unit is BOLO_UNIT_COUNT.
 *
 * The newest frame that can be solved is state->published - 1 - info->lookahead.
 * OK, NOT_YET, OVERWRITTEN, WARM_UP (nothing is written to `values` then); BAD_ARGUMENT: a point outside the frame;
 * UNSUPPORTED: pixels of this stream have parameters of their own, or are changed around the solver: read the deblurred
 * plane instead. Points that stay the same from call to call are fastest. */
BOLO_CLIENT_API int bolo_client_points(bolo_client* client, uint64_t number, const struct bolo_client_point* points,
                                       size_t count, float* values);

/* Keeps the ring that is mapped now, and with it all pointers into it, until released: across restarts and close. Its
 * frames may still be overwritten while its daemon lives. NULL when there is no memory. */
typedef struct bolo_client_hold bolo_client_hold;
BOLO_CLIENT_API bolo_client_hold* bolo_client_hold_new(const bolo_client* client);

/* NULL is fine. Any thread. */
BOLO_CLIENT_API void bolo_client_hold_free(bolo_client_hold* hold);

/* NOLINTEND(readability-identifier-naming,modernize-*) */

#ifdef __cplusplus
}
#endif

#endif /* BOLO_CLIENT_H */
