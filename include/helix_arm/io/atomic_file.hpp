#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace helix_arm::io {

/// A file that is written piece by piece and takes its place all at once: whoever reads its path,
/// at any time and after any end of this process or of the power, finds the old content or the new
/// one, whole.
///
/// A temporary file beside it (`.NAME.<16 digits>.tmp`) is written, synced and renamed, and the
/// folder is synced. A file that is there keeps its permissions, and belongs to who wrote it last;
/// a link to it is followed, a link to nothing is refused. Temporary files of the same name whose
/// writers were killed are removed. Several writers may write at once: the last one stays.
///
/// Everything throws FileError naming path, reason and remedy: a place that cannot be written or is
/// no regular file, a read-only file, a full disk. The old file is then untouched, and no temporary
/// file outlives the object.
class AtomicFile {
 public:
  /// Begins the new content. Nothing of it is seen before commit().
  explicit AtomicFile(const std::string& path);
  /// Without commit() nothing remains of it.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Appends.
  void write(std::string_view bytes);
  /// Writes over what stands from this place on; not beyond what was appended.
  void writeOver(std::size_t place, std::string_view bytes);
  /// Puts it in its place; nothing may be written afterwards. Only where the folder alone cannot be
  /// synced, which the message says, the new file is there already when it throws.
  void commit();

 private:
  class Place;
  std::unique_ptr<Place> place_;
};

/// Writes an AtomicFile of this text. Throws as it does.
void writeFileAtomically(const std::string& path, const std::string& text);

}  // namespace helix_arm::io
