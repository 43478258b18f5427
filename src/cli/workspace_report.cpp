#include "workspace_report.hpp"

#include <iomanip>
#include <iostream>

#include "felt_pressures.hpp"
#include "workspace_progress.hpp"

namespace helix_arm::cli {

using nlohmann::json;

std::string workspaceFailure(const WorkspaceSummary& summary) {
  return summary.points() > 0 ? "" : "no shape balances the load at any sampled input";
}

json toJson(const io::Scene& scene, const statics::TierSetting& setting,
            const WorkspaceArguments& arguments, const WorkspaceSummary& summary) {
  const bool some = summary.points() > 0;
  json sensitivity;
  for (int k = 0; k < statics::kSensitivities && some && arguments.sensitivity; ++k) {
    sensitivity[statics::kSensitivityNames[k]] = {{"median", summary.median(k)},
                                                  {"max", summary.worst[k]}};
  }
  const auto bounds = [](const statics::WorkspaceExtremes& extremes) {
    const auto corner = [](const Eigen::Vector3d& p) { return cli::toJson(Eigen::VectorXd(p)); };
    return json{{"min", corner(extremes.bounds().min())}, {"max", corner(extremes.bounds().max())}};
  };
  const std::string failure = workspaceFailure(summary);
  json document{{"scene", scene.name},
                {"tier", statics::nameOf(setting.tier)},
                {"order", setting.order > 0 ? json(setting.order) : json()},
                {"seed", arguments.seed},
                {"count", summary.inputs},
                {"unbalanced", summary.unbalanced},
                {"failure", failure.empty() ? json() : json(failure)},
                {"seconds", summary.seconds},
                {"points_per_second", static_cast<double>(summary.inputs) / summary.seconds},
                {"bounds_m", some ? bounds(summary.extremes) : json()},
                {"reach_m", some ? json(summary.extremes.reach()) : json()},
                {"sampled_bounds_m", some ? bounds(summary.sampled) : json()},
                {"sampled_reach_m", some ? json(summary.sampled.reach()) : json()},
                {"out", some && !arguments.out.empty() ? json(arguments.out) : json()},
                {"png", some && !arguments.png.empty() ? json(arguments.png) : json()},
                {"sensitivity", sensitivity}};
  addResponse(scene.arm, model::ArmResponse(scene.arm), 0, document);
  return document;
}

CsvTable toCsv(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const WorkspaceSummary& summary) {
  const bool some = summary.points() > 0;
  CsvTable::Row row{{"scene", scene.name},
                    {"tier", statics::nameOf(setting.tier)},
                    {"order", orderCell(setting)},
                    {"seed", std::to_string(arguments.seed)},
                    {"count", std::to_string(summary.inputs)},
                    {"unbalanced", std::to_string(summary.unbalanced)},
                    {"seconds", exact(summary.seconds)}};
  const auto addExtremes = [some, &row](const std::string& prefix,
                                        const statics::WorkspaceExtremes& extremes) {
    const char* const axes[] = {"x_m", "y_m", "z_m"};
    const Eigen::AlignedBox3d bounds = extremes.bounds();
    for (int i = 0; i < 3; ++i) {
      const std::string name = axes[i];
      row.emplace_back(prefix + "min_" + name, some ? exact(bounds.min()[i]) : "");
      row.emplace_back(prefix + "max_" + name, some ? exact(bounds.max()[i]) : "");
    }
    row.emplace_back(prefix + "reach_m", some ? exact(extremes.reach()) : "");
  };
  addExtremes("", summary.extremes);
  for (int k = 0; k < statics::kSensitivities && some && arguments.sensitivity; ++k) {
    const std::string name = statics::kSensitivityNames[k];
    row.emplace_back("median_" + name, exact(summary.median(k)));
    row.emplace_back("max_" + name, exact(summary.worst[k]));
  }
  addExtremes("sampled_", summary.sampled);
  CsvTable table;
  table.add(row);
  return table;
}

void printText(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const WorkspaceSummary& summary) {
  std::cout << scene.name << ", tier " << setting.name() << ": " << summary.inputs << " inputs in "
            << std::setprecision(3) << summary.seconds << " s, "
            << rateText(static_cast<double>(summary.inputs) / summary.seconds) << "\n";
  const std::string note = noteOnResponse(scene.arm);
  if (!note.empty()) std::cout << note << "\n";
  if (summary.unbalanced > 0) {
    std::cout << "inputs omitted because no shape balances the load: " << summary.unbalanced
              << "\n";
  }
  if (summary.points() == 0) {
    std::cout << workspaceFailure(summary) << "\n";
    return;
  }
  const Eigen::AlignedBox3d bounds = summary.extremes.bounds();
  std::cout << "tips, seen from the arm's base: from " << bracketed(bounds.min()) << " to "
            << bracketed(bounds.max()) << " m\nreach " << std::fixed << std::setprecision(6)
            << summary.extremes.reach()
            << " m, searched from the samples and the corners of the limits; "
            << "samples alone " << summary.sampled.reach() << " m\n";
  const char* const errors[] = {"kPa of pressure error", "mm of free length error",
                                "% of stiffness error"};
  for (int k = 0; k < statics::kSensitivities && arguments.sensitivity; ++k) {
    std::cout << "tip displacement per " << errors[k] << ": median " << std::setprecision(3)
              << 1e3 * summary.median(k) << " mm, largest " << 1e3 * summary.worst[k] << " mm\n";
  }
  for (const std::string& file : {arguments.out, arguments.png}) {
    if (!file.empty()) std::cout << "wrote " << file << "\n";
  }
}

}  // namespace helix_arm::cli
