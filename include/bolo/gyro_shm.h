/* Layout of a gyro's samples for bolod ([motion] gyro = "shm:NAME"): POSIX object "/bolo-gyro.NAME", created and
 * written by a program of bolod's user, of root or of the user in bolod's environment variable BOLO_USER. C11 and C++.
 *
 *   offset 0     struct bolo_gyro_header
 *   offset 64    struct bolo_gyro_sample, header.capacity of them: sample n (0, 1, 2 ...) lies in place n % capacity
 *
 * A writer makes the object, writes the header with `written` 0 and `magic` last, and then, of each sample, first the
 * sample and then header.written = n + 1 (release). It waits for nobody. bolod only reads, trusts nothing that it has
 * not checked, and does without while nothing comes: an object may be made, removed and made anew at any time.
 * All values little-endian. Python: "<QIIQ" at 0, "<q3d" at 64 + 32 (n % capacity).
 */
#ifndef BOLO_GYRO_SHM_H
#define BOLO_GYRO_SHM_H

#include <stdint.h>

#define BOLO_GYRO_MAGIC 0x4f5259474f4c4f42ULL /* "BOLOGYRO" */
#define BOLO_GYRO_VERSION 1u
#define BOLO_GYRO_LEAST_CAPACITY 64u
#define BOLO_GYRO_MOST_CAPACITY 16384u

/* Names as C has them. NOLINTBEGIN(readability-identifier-naming) */
struct bolo_gyro_header {
  uint64_t magic;
  uint32_t version;
  uint32_t capacity; /* room for so many samples; a second of them is plenty */
  uint64_t written;  /* samples written so far */
  uint64_t reserved[5];
};

/* Rates about the camera's axes, x to the right, y down, z into the picture, each positive as a right-handed screw:
 * turning right is a positive y, tilting up a positive x, rolling clockwise a positive z. */
struct bolo_gyro_sample {
  int64_t time_ns; /* CLOCK_MONOTONIC of the measurement, strictly rising */
  double rate[3];  /* rad/s */
};
/* NOLINTEND(readability-identifier-naming) */

#endif /* BOLO_GYRO_SHM_H */
