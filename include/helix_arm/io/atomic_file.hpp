#pragma once

#include <string>

namespace helix_arm::io {

/// Writes a file so that whoever reads its path, at any time and after any end of this process or
/// of the power, finds the old content or the new one, whole.
///
/// A temporary file beside it (`.NAME.<16 digits>.tmp`) is written, synced and renamed, and the
/// folder is synced. A file that is there keeps its permissions, and belongs to who wrote it last;
/// a link to it is followed. Temporary files of the same name whose writers were killed are
/// removed. Several writers may write at once: the last one stays.
/// @throws FileError naming path, reason and remedy: a place that cannot be written or is no
/// regular file, a read-only file, a full disk. The old file is then untouched and no temporary
/// file remains; only where the folder alone cannot be synced, which the message says, the new file
/// is there already.
void writeFileAtomically(const std::string& path, const std::string& text);

}  // namespace helix_arm::io
