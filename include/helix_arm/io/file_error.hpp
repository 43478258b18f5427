#pragma once

#include <stdexcept>

namespace helix_arm::io {

/// A file that cannot be read or written; what() names it, the system's reason and a remedy.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace helix_arm::io
