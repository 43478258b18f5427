#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include <sys/types.h>

namespace helix_arm::basics {

/// A regular file, open for reading. Whoever names a path decides what is behind it: a device, a
/// FIFO, a socket or a folder is refused without being opened, and nothing here waits.
class RegularFile {
 public:
  /// Throws nothing; where the file does not open, fault() says why.
  explicit RegularFile(const std::string& path);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;

  bool isOpen() const { return file_ >= 0; }
  /// Why it is not open or was not read, to follow its path: "cannot be read: No such file or
  /// directory", "is a FIFO; expected a regular file". Holds nothing of the file.
  const std::string& fault() const { return fault_; }
  int descriptor() const { return file_; }

  /// All of its bytes; nothing, and a fault that names the limit, where there are more than `most`.
  std::optional<std::string> readAll(std::size_t most);
  /// The bytes from a place on, as many as there are up to `size`; 0 at the end, -1 with a fault.
  ssize_t readAt(std::uint64_t place, void* bytes, std::size_t size);
  /// The size now [bytes].
  std::uint64_t size() const;
  /// True where nobody has written to it since it was opened, by its size and its times.
  bool isUnchanged() const;

 private:
  /// What tells a file that was written to.
  struct Version {
    std::uint64_t size = 0;
    std::int64_t modified_s = 0, modified_ns = 0, changed_s = 0, changed_ns = 0;
  };
  std::optional<Version> version() const;

  int file_ = -1;
  Version opened_;
  std::string fault_;
};

/// Why a file of more bytes than `most` is refused: "is larger than 4 MiB".
std::string largerThan(std::uint64_t most);

}  // namespace helix_arm::basics
