/* A reader waits for the next frame of the shared-memory ring by a futex (ShmReader::wait, ShmSink::publish) and must never
 * sleep while a frame is there. A reader that is never woken is a deadlock, which the checker reports. Timeouts would hide
 * it, so readers have none, except against THIEF, a hostile reader that requeues sleepers to another futex (FUTEX_REQUEUE),
 * where the writer does not wake them. The kernel compares the word with the value seen by the reader and puts it to sleep
 * in one step; FUTEX_WAKE comes after the caller's earlier stores.
 *
 * READER may wait for any frame; a thread later wakes the rest beyond four readers. Each other definition breaks the
 * protocol in one place. */
#ifndef FRAMES
#define FRAMES 3
#endif
#define READERS 2
#define PUBLISHED 0
#define WAKE 1
#define LOCATIONS 2
#define VALUES (FRAMES + 1)

#include "memory.pml"

View writer;
bool stolen[READERS];
bool asleep[READERS];
byte asked = 0, served = 0;
bool ended = false;

active proctype Writer() {
  byte n = 0;
  do
  :: n < FRAMES ->
#ifdef WAKE_FIRST
    store(writer, WAKE, n + 1, ORDERED);
    store(writer, PUBLISHED, n + 1, ORDERED);
#else
    store(writer, PUBLISHED, n + 1, ORDERED); /* W4 */
    store(writer, WAKE, n + 1, ORDERED);      /* W5 */
#endif
    atomic { /* FUTEX_WAKE of one; the waker's thread wakes the others */
      if
      :: asleep[0] -> asleep[0] = false
      :: asleep[1] -> asleep[1] = false
      :: !asleep[0] && !asleep[1]
      fi;
      asked++
    };
    n++
  :: else -> break
  od;
  ended = true
}

active proctype Rest() {
  do
  :: served < asked -> served = asked;
#ifndef FORGETS_THE_REST
    atomic { asleep[0] = false; asleep[1] = false }
#endif
  :: ended && served == asked -> break
  od
}

active [READERS] proctype Reader() {
  View me;
  byte wanted = 0, wake_seen, published;
  byte id = _pid - 2; /* processes 0 and 1: Writer and Rest */
  do /* any frame */
  :: wanted < FRAMES - 1 -> wanted++
  :: break
  od;
  do
  :: 1 ->
#ifdef PUBLISHED_FIRST
    load(me, PUBLISHED, published, ORDERED);
    load(me, WAKE, wake_seen, ORDERED);
#else
    load(me, WAKE, wake_seen, ORDERED);
    load(me, PUBLISHED, published, ORDERED);
#endif
    if
    :: published > wanted -> break
    :: else
    fi;
    atomic { /* FUTEX_WAIT */
      if
      :: memory[WAKE].written[memory[WAKE].count].value == wake_seen -> asleep[id] = true
      :: else
      fi
    };
    if
    :: !asleep[id] && !stolen[id]
#ifndef SLEEPS_ON
    :: stolen[id] -> stolen[id] = false /* its timeout */
#endif
    fi
  od
}

#ifdef THIEF
active proctype Thief() {
end:
  do
  :: atomic { asleep[0] -> asleep[0] = false; stolen[0] = true }
  :: atomic { asleep[1] -> asleep[1] = false; stolen[1] = true }
  od
}
#endif
