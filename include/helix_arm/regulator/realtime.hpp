#pragma once

#include <string>

/// What the threads between targets and valves ask of the machine: to run when they are due,
/// whatever else wants to. Where the user's limits refuse it everything works as before, later on a
/// machine that is busy.
namespace helix_arm::regulator {

/// Of the threads, below the kernel's own for interrupts (50).
inline constexpr int kRealtimePriority = 40;
inline constexpr int kHighestRealtimePriority = 99;

/// Schedules the calling thread SCHED_FIFO; what it starts is scheduled as ever.
/// @param priority  0: leaves it as it is; up to kHighestRealtimePriority.
/// @return why not, with the remedy; empty: it is done, or was not wanted.
std::string scheduleRealtime(int priority);

/// Whether scheduleRealtime() works here, tried on a thread of its own.
/// @return as scheduleRealtime().
std::string tryRealtime(int priority);

/// Keeps this process's memory from being swapped out, from now on.
/// @return why not, with the remedy; empty: it is done.
std::string lockMemory();

}  // namespace helix_arm::regulator
