#pragma once

#include <cstdint>
#include <string>

#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/statics/workspace.hpp"

namespace helix_arm::cli {

/// What a file of points says of them.
struct CloudOrigin {
  std::string scene, tier;
  std::uint64_t seed = 1;
  bool sensitivity = false;
};

/// Points as a PLY (binary, little-endian; tips and sensitivity as float32) or a CSV (inputs, tips
/// and sensitivity, with units in the header), by the end of its name; written piece by piece.
class CloudFile {
 public:
  /// @throws CallerError on another end of the name, io::FileError where it cannot be written.
  CloudFile(const std::string& path, const model::Arm& arm, const CloudOrigin& origin);

  /// Points as they stand in the file. From any thread.
  std::string encode(const statics::WorkspacePoints& points) const;

  /// Appends so many encoded points. @throws io::FileError.
  void write(const std::string& encoded, std::uint64_t points);

  /// Puts the file in its place, not before. @throws io::FileError.
  void finish();

 private:
  std::string plyHeader() const;
  std::string csvHeader() const;
  std::string encodePly(const statics::WorkspacePoints& points) const;
  std::string encodeCsv(const statics::WorkspacePoints& points) const;

  const model::Arm& arm_;
  const CloudOrigin origin_;
  const bool ply_;
  std::uint64_t points_ = 0;
  io::AtomicFile file_;
};

}  // namespace helix_arm::cli
