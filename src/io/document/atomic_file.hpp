#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include "basics/regular_file.hpp"

namespace helix_arm::io {

/// A file that cannot be read or written; what() names it, the system's reason and a remedy.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A file that is written in pieces and replaced atomically: a reader of its path always finds the
/// complete old or the complete new content, even after a crash or a power failure.
///
/// A temporary file beside it (`.NAME.<16 digits>.tmp`) is written, synced and renamed, and the
/// folder is synced. An existing file keeps its permissions and is then owned by its last writer.
/// A link from one scene (.yaml) to another is followed; every other link is refused. Several
/// writers may write at once: the last one wins. One that is killed leaves its temporary file.
///
/// All members throw FileError naming path, reason and remedy: on a path that cannot be written or
/// is no regular file, a read-only file, a full disk. The old file is then unchanged, and no
/// temporary file outlives the object.
class AtomicFile {
 public:
  /// Starts the new content, which is invisible until commit().
  explicit AtomicFile(const std::string& path);
  /// Discards the new content unless commit() was called.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Appends.
  void write(std::string_view bytes);
  /// Overwrites bytes from this position on; not beyond what was appended.
  void writeOver(std::size_t place, std::string_view bytes);
  /// Replaces the file; nothing may be written afterwards. If only the folder cannot be synced, it
  /// throws although the new file is in place; the message says so.
  void commit();

 private:
  void discard();

  const std::string path_, target_;  // as given, and what is replaced
  std::string temporary_;            // beside it; empty once it is renamed
  int file_ = -1;
  std::size_t end_ = 0;
};

/// Writes this text as an AtomicFile. Throws as AtomicFile does.
void writeFileAtomically(const std::string& path, const std::string& text);

/// SHA-256 of bytes, 64 hexadecimal digits.
std::string sha256Of(const std::string& content);

/// SHA-256 of an open file, which may be read further afterwards.
/// @param path  path of the file, for messages.
/// @param most  [bytes]
/// @throws FileError if it is not open, cannot be read or has more bytes.
std::string sha256OfFile(basics::RegularFile& file, const std::string& path, std::uint64_t most);

/// SHA-256 of the content of a regular file of at most 64 MiB.
/// @throws FileError if it is no regular file, is larger or cannot be read.
std::string sha256OfFile(const std::string& path);

}  // namespace helix_arm::io
