#include "workspace_report.hpp"

#include <cmath>
#include <iomanip>
#include <iostream>

#include "effective_pressures.hpp"
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
  const auto bounds = [](const Eigen::AlignedBox3d& box) {
    return json{{"min", cli::toJson(Eigen::VectorXd(box.min()))},
                {"max", cli::toJson(Eigen::VectorXd(box.max()))}};
  };
  const std::string failure = workspaceFailure(summary);
  const bool bounded = some && std::isfinite(summary.extremes.reachBound());
  json document{{"scene", scene.name},
                {"tier", statics::nameOf(setting.tier)},
                {"order", setting.order > 0 ? json(setting.order) : json()},
                {"seed", arguments.seed},
                {"count", summary.inputs},
                {"unbalanced", summary.unbalanced},
                {"failure", failure.empty() ? json() : json(failure)},
                {"seconds", summary.seconds},
                {"points_per_second", static_cast<double>(summary.inputs) / summary.seconds},
                {"bounds_m", some ? bounds(summary.extremes.bounds()) : json()},
                {"reach_m", some ? json(summary.extremes.reach()) : json()},
                {"outer_bounds_m", bounded ? bounds(summary.extremes.outerBounds()) : json()},
                {"reach_bound_m", bounded ? json(summary.extremes.reachBound()) : json()},
                {"reach_certified", summary.extremes.certified()},
                {"sampled_bounds_m", some ? bounds(summary.sampled.bounds()) : json()},
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
  const bool bounded = some && std::isfinite(summary.extremes.reachBound());
  row.emplace_back("reach_bound_m", bounded ? exact(summary.extremes.reachBound()) : "");
  row.emplace_back("reach_certified", summary.extremes.certified() ? "true" : "false");
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
            << (summary.extremes.certified() ? "" : "at least ") << summary.extremes.reach()
            << " m; ";
  if (std::isfinite(summary.extremes.reachBound())) {
    std::cout << "no tip is farther than " << summary.extremes.reachBound() << " m; ";
  } else {
    std::cout << "no bound is known under load or with a taper; ";
  }
  std::cout << "samples alone " << summary.sampled.reach() << " m\n";
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
