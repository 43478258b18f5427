#pragma once

#include <cstddef>
#include <string>
#include <system_error>

#include <sys/mman.h>
#include <unistd.h>

namespace helix_arm::test {

/// A file that is in no folder, for readers that take paths.
class MemoryFile {
 public:
  MemoryFile() : file_(memfd_create("fuzz", MFD_CLOEXEC)) {
    if (file_ < 0) throw std::system_error(errno, std::generic_category(), "memfd_create");
  }
  ~MemoryFile() { close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  /// Replaces what it holds.
  void write(const void* data, std::size_t size) const {
    if (ftruncate(file_, 0) != 0 || pwrite(file_, data, size, 0) != static_cast<ssize_t>(size)) {
      throw std::system_error(errno, std::generic_category(), "memory file");
    }
  }
  std::string path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

/// Ends the process, as a finding, where a law does not hold.
inline void demand(bool law) {
  if (!law) __builtin_trap();
}

}  // namespace helix_arm::test
