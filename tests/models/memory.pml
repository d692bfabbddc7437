/* Memory of C++'s atomics: release, acquire and relaxed, and what a processor with weak order may show.
 *
 * A location keeps every value that was ever written to it, in order. A thread's view says, for each location, the
 * oldest value that it may still read: it reads that one or any newer, whichever chance (the checker: every) takes, and
 * never an older one again. A release leaves the writer's view with the value; an acquire that reads it takes that view
 * up. A relaxed read only remembers it: a fence takes up all that was remembered.
 *
 * Not in it: reads of values that nobody has written yet. Loads that acquire, and stores behind a load whose value they
 * depend on, can't do that.
 *
 * The includer defines LOCATIONS and VALUES (of a location, with the zero that it begins with). One writer each. */

typedef Value {
  byte value;
  byte view[LOCATIONS]
}
typedef Location {
  Value written[VALUES];
  byte count /* beyond the zero */
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
    do /* any value that it may still see */
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
