#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include <sys/stat.h>

namespace helix_arm::basics {

/// A regular file, open for reading. A device, FIFO, socket or directory at the path is refused
/// without being opened, so nothing here blocks.
class RegularFile {
 public:
  /// Does not throw; if the file cannot be opened, fault() gives the reason.
  explicit RegularFile(const std::string& path);
  ~RegularFile();
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;

  bool isOpen() const { return file_ >= 0; }
  /// Why it is not open or could not be read, phrased to follow its path: "cannot be read: No such
  /// file or directory", "is a FIFO; expected a regular file". Contains none of the file's
  /// contents.
  const std::string& fault() const { return fault_; }
  int descriptor() const { return file_; }

  /// The whole contents; empty, with a fault that names the limit, if there are more than `most`
  /// bytes.
  std::optional<std::string> readAll(std::size_t most);
  /// Reads up to `size` bytes from a position. @return the number of bytes read; 0 at the end, -1
  /// with a fault.
  ssize_t readAt(std::uint64_t place, void* bytes, std::size_t size);
  /// Current size [bytes].
  std::uint64_t size() const;
  /// True if the file was not written to since it was opened, judged by its size and times.
  bool isUnchanged() const;

 private:
  struct stat status() const;

  int file_ = -1;
  struct stat opened_ {};  ///< when it was opened
  std::string fault_;
};

/// Reason for refusing a file of more than `most` bytes: "is larger than 4 MiB".
std::string largerThan(std::uint64_t most);

}  // namespace helix_arm::basics
