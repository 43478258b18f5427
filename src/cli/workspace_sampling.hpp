#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "helix_arm/statics/workspace_extremes.hpp"
#include "workspace_file.hpp"
#include "workspace_maps.hpp"

namespace helix_arm::cli {

inline constexpr std::uint64_t kUsualCount = 10000000;
inline constexpr std::uint64_t kUsualSensitiveCount = 200000;

/// What a user asks of `workspace`.
struct WorkspaceArguments {
  std::string scene, out, png;
  std::optional<std::uint64_t> count;
  std::uint64_t seed = 1;
  bool sensitivity = false;
  int threads = 0;  // 0: all cores
  TierArguments tier;

  std::uint64_t inputs() const {
    return count.value_or(sensitivity ? kUsualSensitiveCount : kUsualCount);
  }
};

/// What the sampled points say.
struct WorkspaceSummary {
  std::uint64_t inputs = 0, unbalanced = 0;
  double seconds = 0.0;
  statics::WorkspaceExtremes sampled;   // of the points
  statics::WorkspaceExtremes extremes;  // that a search found from there
  Eigen::Vector3d worst = Eigen::Vector3d::Zero();
  std::vector<CloudPoint> kept;
  bool whole = false;  // not interrupted

  std::uint64_t points() const { return inputs - unbalanced; }
  /// Of sensitivity k over the kept points [m]; there is at least one.
  double median(int k) const;
};

/// Samples on all threads and takes the pieces in their order, so that the result does not tell how
/// many threads there were. Ends early when interrupted.
/// @param file  for the points, finished if it is whole and has any; or null.
/// @throws io::FileError where the file cannot be written.
WorkspaceSummary sampleWorkspace(const statics::Workspace& workspace,
                                 const WorkspaceArguments& arguments, CloudFile* file);

}  // namespace helix_arm::cli
