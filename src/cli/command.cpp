#include "command.hpp"

#include <atomic>
#include <cstddef>

namespace helix_arm::cli {
namespace {

std::atomic<bool> noted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets it");

}  // namespace

InterruptWatch::InterruptWatch() {
  noted = false;
  struct sigaction action {};
  action.sa_handler = [](int) { noted = true; };
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &before_[i]);
}

InterruptWatch::~InterruptWatch() {
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
}

bool interrupted() { return noted; }

}  // namespace helix_arm::cli
