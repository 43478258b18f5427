#pragma once

#include <string>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/tier.hpp"
#include "nlohmann/json.hpp"
#include "output.hpp"
#include "workspace_sampling.hpp"

namespace helix_arm::cli {

/// Why there are no points; empty where there are some.
std::string workspaceFailure(const WorkspaceSummary& summary);

/// The summary as `workspace` gives it, in each format; its footer names the keys.
/// @param setting  the tier that computed the points.
nlohmann::json toJson(const io::Scene& scene, const statics::TierSetting& setting,
                      const WorkspaceArguments& arguments, const WorkspaceSummary& summary);
CsvTable toCsv(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const WorkspaceSummary& summary);
/// On stdout.
void printText(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const WorkspaceSummary& summary);

}  // namespace helix_arm::cli
