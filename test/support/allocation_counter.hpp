#pragma once

#include <cstddef>

namespace helix_arm::test {

/// Counts calls of operator new and malloc while it lives (this thread). Link support/allocation_counter.cpp.
class AllocationCounter {
 public:
  AllocationCounter();
  ~AllocationCounter();
  AllocationCounter(const AllocationCounter&) = delete;
  AllocationCounter& operator=(const AllocationCounter&) = delete;
  std::size_t count() const;
};

}  // namespace helix_arm::test
