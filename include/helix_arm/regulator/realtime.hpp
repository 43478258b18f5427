#pragma once

#include <string>

/// Real-time scheduling and memory locking for the threads between targets and valves. If the
/// user's limits refuse it, everything still works, with delays on a busy machine.
namespace helix_arm::regulator {

/// Default priority of these threads, below that of the kernel's interrupt threads (50).
inline constexpr int kRealtimePriority = 40;
inline constexpr int kHighestRealtimePriority = 99;

/// Schedules the calling thread as SCHED_FIFO; threads that it starts keep ordinary scheduling.
/// @param priority  0 for no change, up to kHighestRealtimePriority.
/// @return the reason for failure and the remedy; empty on success and for priority 0.
std::string scheduleRealtime(int priority);

/// Tests whether scheduleRealtime() works here, on a separate thread.
/// @return as scheduleRealtime().
std::string tryRealtime(int priority);

/// Prevents this process's memory from being swapped out from now on.
/// @return the reason for failure and the remedy; empty on success.
std::string lockMemory();

}  // namespace helix_arm::regulator
