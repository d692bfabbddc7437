/* A slot of the shared-memory ring, as drawn in include/bolo/shm_layout.h: a reader never accepts another frame's words, or
 * a mixture, for the requested one. W1 to W4 and R1 to R3 refer to the drawing.
 *
 * BORROW: the reader reads the planes in place with plain loads, and has a barrier before R3 (shared_words.hpp). Plain
 * loads of words that are written concurrently are modelled as relaxed ones, as processors execute them.
 * W3 with R1, or W4 with the load of `published` before R1: either pair alone is sufficient (the model holds with W3 or R1
 * relaxed). Both are kept, as a reader may know by other means that a frame is there.
 *
 * Each other definition breaks the protocol in one place; the checker must then find a torn frame. */
#ifndef FRAMES
#define FRAMES 3
#endif
#ifndef SLOTS
#define SLOTS 1
#endif
#define WORDS 2
#define LOCATIONS (SLOTS * (1 + WORDS) + 1)
#define VALUES (2 * FRAMES + 1)
#define SEQUENCE(n) ((n % SLOTS) * (1 + WORDS))
#define WORD(n, i) (SEQUENCE(n) + 1 + i)
#define PUBLISHED (LOCATIONS - 1)

#include "memory.pml"

#ifndef W2
#define W2 ORDERED
#endif
#ifndef W3
#define W3 ORDERED
#endif
#ifndef W4
#define W4 ORDERED
#endif
#ifndef R1
#define R1 ORDERED
#endif
#ifndef R2
#ifdef BORROW
#define R2 RELAXED
#else
#define R2 ORDERED
#endif
#endif

View writer, reader;

active proctype Writer() {
  byte n = 0;
  do
  :: n < FRAMES ->
#ifndef NO_W1
    store(writer, SEQUENCE(n), 2 * n + 1, RELAXED); /* W1 */
#endif
    store(writer, WORD(n, 0), n + 1, W2);
    store(writer, WORD(n, 1), n + 1, W2);
    store(writer, SEQUENCE(n), 2 * n + 2, W3);
    store(writer, PUBLISHED, n + 1, W4);
    n++
  :: else -> break
  od
}

active proctype Reader() {
  byte n, seen, first, second, turn = 0;
  do
  :: turn < 2 ->
    turn++;
    n = 0;
    do /* any frame */
    :: n < FRAMES - 1 -> n++
    :: break
    od;
    load(reader, PUBLISHED, seen, ORDERED);
    if
    :: seen > n
    :: else -> goto next
    fi;
    load(reader, SEQUENCE(n), seen, R1);
    if
    :: seen == 2 * n + 2
    :: else -> goto next
    fi;
    if /* in any order */
    :: load(reader, WORD(n, 0), first, R2); load(reader, WORD(n, 1), second, R2)
    :: load(reader, WORD(n, 1), second, R2); load(reader, WORD(n, 0), first, R2)
    fi;
#if defined(BORROW) && !defined(NO_BARRIER)
    acquire_fence(reader);
#endif
    load(reader, SEQUENCE(n), seen, RELAXED); /* R3 */
    if
    :: seen == 2 * n + 2 ->
      assert(first == n + 1 && second == n + 1);
#ifdef NEVER_READS
      assert(false) /* must be reachable: frames are read */
#endif
    :: else
    fi;
next:
    first = 0; second = 0; seen = 0
  :: else -> break
  od
}
