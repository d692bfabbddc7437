/* A share of rt::WorkerTeam (src/rt/thread.hpp): each part is done once, with its own round's job, and the caller sees all
 * results. Round 1 has one part and round 2 two; the worker comes at any time, or never.
 *
 * DATA and RESULT are the job's own memory, plain values. A caller that waits for ever is a deadlock, which the checker
 * reports. Each definition breaks the protocol in one place. */
#define ROUNDS 2
#define JOB 0
#define PARTS 1
#define NEXT 2 /* eight values per round: 0: closed; the others: the part to take next */
#define DONE 3
#define DATA 4
#define RESULT(part) (5 + part)
#define LOCATIONS 7
#define VALUES 10
#define closed(round) (8 * round)
#define at_part(round, part) (8 * round + 1 + part)

#include "memory.pml"

#ifndef OPENS
#define OPENS ORDERED
#endif
#ifndef READS
#define READS ORDERED
#endif
#ifndef FINISHES
#define FINISHES ORDERED
#endif

#define latest(location) memory[location].written[memory[location].count].value

View caller, worker;
byte ran[4]; /* by round and part */
byte found; /* inside atomic steps only */

/* Atomically adds 1 to the latest value. */
inline add(thread, location, order) {
  atomic {
    thread.at[location] = memory[location].count;
    load(thread, location, found, order);
    store(thread, location, found + 1, order);
    found = 0
  }
}

inline take_share(thread, next, parts, job, part, mine) {
  load(thread, NEXT, next, READS);
  do
  :: load(thread, PARTS, parts, ORDERED);
    load(thread, JOB, job, ORDERED);
    part = next % 8;
    if
    :: part == 0 || part > parts -> break
    :: else -> part--
    fi;
    if
    :: atomic { latest(NEXT) == next -> add(thread, NEXT, ORDERED) }
      assert(job == next / 8);
      assert(newest(thread, DATA));
      assert(part < 2);
      store(thread, RESULT(part), job, RELAXED);
      mine++;
      ran[2 * (job - 1) + part]++;
      assert(ran[2 * (job - 1) + part] == 1);
      add(thread, DONE, FINISHES);
      next++
    :: load(thread, NEXT, next, READS) /* another was faster, or spurious failure */
    fi
  od
}

active proctype Caller() {
  byte round = 1, next, parts, job, part, mine;
  do
  :: round <= ROUNDS ->
    store(caller, DATA, round, RELAXED);
    store(caller, PARTS, round, ORDERED);
    store(caller, JOB, round, ORDERED);
    store(caller, DONE, 0, RELAXED);
    store(caller, NEXT, at_part(round, 0), OPENS);
    take_share(caller, next, parts, job, part, mine);
    atomic { latest(DONE) == round -> caller.at[DONE] = memory[DONE].count; load(caller, DONE, found, ORDERED) }
    assert(newest(caller, RESULT(0)) && newest(caller, RESULT(1)));
#ifndef NEVER_CLOSES
    store(caller, NEXT, closed(round), RELAXED);
#endif
    round++
  :: else -> break
  od;
  assert(ran[0] == 1 && ran[1] == 0 && ran[2] == 1 && ran[3] == 1)
}

active proctype Worker() {
  byte times, next, parts, job, part, mine;
  do
  :: times < 3 ->
    take_share(worker, next, parts, job, part, mine);
#ifdef NEVER_HELPS
    assert(mine < 3); /* must be reachable: the worker does all parts */
#endif
    times++
  :: break
  od
}
