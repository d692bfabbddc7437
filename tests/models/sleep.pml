/* The sleeping consumer of rt::SpscQueue (src/rt/spsc_queue.hpp): it never sleeps on an item or a wake(), and bells do not
 * accumulate. P3 to P5 and S1 to S4 refer to the header's drawing. There are no timeouts, which would hide a lost wake-up:
 * a consumer that waits for ever is a deadlock, which the checker reports.
 *
 * All orders here are seq_cst except one: on its way out pop_wait() withdraws its announcement by a relaxed store, which
 * others may see late. `late`: that store is in flight. Each definition breaks the protocol in one place. */
#ifndef ITEMS
#define ITEMS 3
#endif
#define RINGERS 2 /* threads that ring: the producer, and who calls wake() */

byte tail = 0, head = 0;
bool sleeping = false, woken = false, late = false;
byte bells = 0;
bool heard = false; /* the consumer returned because of wake() */

inline ring_if_sleeping() {
  if
  :: sleeping -> /* P4 */
    atomic { /* P5: exchange */
      if
      :: sleeping -> sleeping = false; bells++; assert(bells <= 1 + RINGERS)
      :: else
      fi
    }
  :: else
  fi
}

active proctype Producer() {
  do
  :: tail < ITEMS ->
#ifdef ASKS_FIRST
    ring_if_sleeping();
    tail++
#else
    tail++; /* P3 */
    ring_if_sleeping()
#endif
  :: else -> break
  od
}

active proctype Other() { /* wake() */
  woken = true;
  ring_if_sleeping()
}

active proctype LateStore() {
end:
  do
  :: atomic { late -> late = false; sleeping = false }
  od
}

/* Ordered after its own earlier store to the same variable. */
inline announce() {
  atomic { late = false; sleeping = true }
}

active proctype Consumer() {
  do
  :: head == ITEMS && heard -> break
  :: else ->
    /* pop_wait() */
    if
    :: head < tail -> head++; goto done
    :: else
    fi;
again:
    do /* S1 */
    :: atomic { bells > 0 -> bells-- }
    :: bells == 0 -> break
    od;
#ifdef LOOKS_FIRST
    if
    :: head < tail -> head++; late = true; goto done
    :: else
    fi;
    announce();
#else
    announce(); /* S2 */
    if /* S3 */
    :: head < tail -> head++; late = true; goto done
    :: else
    fi;
#endif
#ifndef IGNORES_WAKE
    atomic {
      if
      :: woken -> woken = false; heard = true; late = true; goto done
      :: else
      fi
    };
#endif
    atomic { bells > 0 -> bells-- }; /* S4 */
    goto again;
done:
    skip
  od
}
