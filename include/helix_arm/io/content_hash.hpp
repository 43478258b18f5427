#pragma once

#include <string>

namespace helix_arm::io {

/// SHA-256 of bytes, 64 hexadecimal digits.
std::string sha256Of(const std::string& content);

/// SHA-256 of a file's content.
/// @throws FileError where it cannot be read.
std::string sha256OfFile(const std::string& path);

}  // namespace helix_arm::io
