/* The cells of rt::SpscQueue (src/rt/spsc_queue.hpp): both sides never access a cell at once, although cells are plain
 * values, and items come out whole and in order. P1 to P3 and C1 to C3 refer to the header's drawing.
 *
 * READ is not in the queue's memory: it models the consumer's read of a cell, which the producer's next write to that cell
 * must follow. Each definition breaks the protocol in one place. */
#ifndef ITEMS
#define ITEMS 4
#endif
#define CAPACITY 2
#define TAIL 0
#define HEAD 1
#define CELL(i) (2 + i % CAPACITY)
#define READ(i) (2 + CAPACITY + i % CAPACITY)
#define LOCATIONS (2 + 2 * CAPACITY)
#define VALUES (ITEMS + 1)

#include "memory.pml"

#ifndef P1
#define P1 ORDERED
#endif
#ifndef P3
#define P3 ORDERED /* in fact seq_cst, for the sleeping consumer: sleep.pml */
#endif
#ifndef C1
#define C1 ORDERED
#endif
#ifndef C3
#define C3 ORDERED
#endif

View producer, consumer;
byte popped = 0;

active proctype Producer() {
  byte tail = 0, seen_head = 0;
  do
  :: tail < ITEMS ->
    if
    :: tail - seen_head == CAPACITY -> load(producer, HEAD, seen_head, P1)
    :: else
    fi;
    if
#ifdef ONE_TOO_MANY
    :: tail - seen_head <= CAPACITY ->
#else
    :: tail - seen_head < CAPACITY ->
#endif
      assert(newest(producer, CELL(tail)));
      assert(newest(producer, READ(tail))); /* no write while the consumer reads */
      store(producer, CELL(tail), tail + 1, RELAXED); /* P2 */
      store(producer, TAIL, tail + 1, P3);
      tail++
    :: else
    fi
  :: else -> break
  od
}

active proctype Consumer() {
  byte head = 0, seen_tail = 0, item = 0;
  do
  :: head < ITEMS ->
    if
    :: head == seen_tail -> load(consumer, TAIL, seen_tail, C1)
    :: else
    fi;
    if
    :: head != seen_tail ->
      assert(newest(consumer, CELL(head))); /* no read while the producer writes */
      load(consumer, CELL(head), item, RELAXED); /* C2 */
      assert(item == head + 1);
      store(consumer, READ(head), head + 1, RELAXED);
      store(consumer, HEAD, head + 1, C3);
      head++;
      popped++;
#ifdef NEVER_READS
      assert(popped < ITEMS); /* must be reachable: all items come out */
#endif
      item = 0
    :: else
    fi
  :: else -> break
  od
}
