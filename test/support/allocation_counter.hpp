#pragma once

#include <cstddef>

namespace helix_arm::test {

/// Counts this thread's heap allocations since it was made. Link the target
/// helix_arm_allocation_counter.
class AllocationCounter {
 public:
  AllocationCounter();
  std::size_t count() const;

 private:
  std::size_t before_;
};

}  // namespace helix_arm::test
