#include "support/allocation_counter.hpp"

#include <cstdlib>
#include <cstring>

namespace {
thread_local std::size_t allocations = 0;
}  // namespace

// glibc's own entry points: every allocation passes here, Eigen's and operator new's alike.
extern "C" {
void* __libc_malloc(std::size_t size);                           // NOLINT
void* __libc_calloc(std::size_t count, std::size_t size);        // NOLINT
void* __libc_realloc(void* block, std::size_t size);             // NOLINT
void* __libc_memalign(std::size_t alignment, std::size_t size);  // NOLINT

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* block, std::size_t size) {
  ++allocations;
  return __libc_realloc(block, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  ++allocations;
  *block = __libc_memalign(alignment, size);
  return *block == nullptr ? 12 : 0;  // ENOMEM
}
}

namespace helix_arm::test {

AllocationCounter::AllocationCounter() : before_(allocations) {}

std::size_t AllocationCounter::count() const { return allocations - before_; }

}  // namespace helix_arm::test
