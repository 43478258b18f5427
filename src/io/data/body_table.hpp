#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// Poses of motion-capture bodies over time, in the frame of their file.
struct BodyTable {
  std::vector<double> time;  ///< (rows) ascending [s]
  /// (rows x bodies) nothing where the system lost it; without a rotation in the file its identity.
  std::vector<std::vector<std::optional<lie::SE3>>> poses;
  std::string sha256;  ///< hash of the bytes that were read
};

/// Whether a file is a recording of bodies, by its first lines: a table with columns NAME_x_m, or
/// an export of OptiTrack Motive or of Vicon Nexus or Tracker.
bool isBodyTable(const std::string& path);

/// Reads a recording of these bodies:
/// * a table with the columns time_s, NAME_x_m, NAME_y_m, NAME_z_m and, if the rotation is known,
///   NAME_qx, NAME_qy, NAME_qz, NAME_qw; cells of lost bodies are empty.
/// * a CSV export of Motive (rigid bodies; rotations as quaternions; any unit of length).
/// * a CSV export of Vicon (objects or segments; rotations as angle times axis in deg or rad, or as
///   quaternions RX RY RZ RW). A body is known by its name, or by what follows the colon.
/// @throws DocumentError with all faults: bodies that the file lacks, numbers that are none, times
/// that fall.
BodyTable loadBodyTable(const std::string& path, const std::vector<std::string>& names);

}  // namespace helix_arm::io
