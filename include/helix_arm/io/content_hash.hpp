#pragma once

#include <cstdint>
#include <string>

#include "helix_arm/basics/regular_file.hpp"

namespace helix_arm::io {

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
