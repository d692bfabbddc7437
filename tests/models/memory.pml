/* C++'s memory model for atomics: release, acquire and relaxed, as a weakly ordered processor may execute them.
 *
 * A location keeps every value ever written to it, in order. A thread's view states the oldest value of each location that
 * it may still read: it reads that one or any newer (the checker tries every choice), and never an older one again. A
 * release stores the writer's view with the value; an acquire that reads the value takes over this view. A relaxed read
 * only remembers it: a fence takes over all remembered views.
 *
 * Not modelled: reads of values that are not written yet. Acquire loads, and stores that depend on a load's value, cannot
 * cause them.
 *
 * The includer defines LOCATIONS and VALUES (per location, including the initial zero). One writer per location. */

typedef Value {
  byte value;
  byte view[LOCATIONS]
}
typedef Location {
  Value written[VALUES];
  byte count /* without the zero */
}
typedef View {
  byte at[LOCATIONS];
  byte heard[LOCATIONS] /* by relaxed reads, until a fence */
}

Location memory[LOCATIONS];
byte scratch; /* inside atomic steps only */

#define RELAXED 0
#define ORDERED 1 /* release of a store, acquire of a load */

#define raise(to, from) to = (to < from -> from : to)
#define newest(thread, location) (thread.at[location] == memory[location].count)

inline store(thread, location, number, order) {
  atomic {
    memory[location].count++;
    thread.at[location] = memory[location].count;
    memory[location].written[memory[location].count].value = number;
    scratch = 0;
    do
    :: scratch < LOCATIONS ->
      memory[location].written[memory[location].count].view[scratch] =
        (order == ORDERED -> thread.at[scratch] : (scratch == location -> memory[location].count : 0));
      scratch++
    :: else -> break
    od;
    scratch = 0
  }
}

inline load(thread, location, into, order) {
  atomic {
    do /* any value allowed by its view */
    :: thread.at[location] < memory[location].count -> thread.at[location]++
    :: break
    od;
    into = memory[location].written[thread.at[location]].value;
    scratch = 0;
    do
    :: scratch < LOCATIONS ->
      if
      :: order == ORDERED -> raise(thread.at[scratch], memory[location].written[thread.at[location]].view[scratch])
      :: else -> raise(thread.heard[scratch], memory[location].written[thread.at[location]].view[scratch])
      fi;
      scratch++
    :: else -> break
    od;
    scratch = 0
  }
}

inline acquire_fence(thread) {
  atomic {
    scratch = 0;
    do
    :: scratch < LOCATIONS ->
      raise(thread.at[scratch], thread.heard[scratch]);
      scratch++
    :: else -> break
    od;
    scratch = 0
  }
}
