#pragma once

#include <cstdint>
#include <string>

#include "helix_arm/basics/regular_file.hpp"

namespace helix_arm::io {

/// SHA-256 of bytes, 64 hexadecimal digits.
std::string sha256Of(const std::string& content);

/// SHA-256 of a file that is open, and may be read on afterwards.
/// @param path  of the file, for the message.
/// @param most  [bytes]
/// @throws FileError where it is not open, cannot be read or has more bytes.
std::string sha256OfFile(basics::RegularFile& file, const std::string& path, std::uint64_t most);

/// SHA-256 of the content of a regular file of at most 64 MiB.
/// @throws FileError where it is none or cannot be read.
std::string sha256OfFile(const std::string& path);

}  // namespace helix_arm::io
