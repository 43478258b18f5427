#include "follow_report.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <sstream>

#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using procedures::FollowResult;
using procedures::FollowRow;

constexpr std::size_t kMostDrawn = 5000;  // rows of a run in a picture

const char* visionName(const procedures::FollowPlan& plan) {
  return plan.vision == simulation::VisionKind::kRendered ? "rendered" : "corners";
}

json statesJson(const FollowResult& result) {
  json states = json::array();
  for (const procedures::FollowState& change : result.states) {
    states.push_back({{"time_s", change.time}, {"state", nameOf(change.state)}});
  }
  return states;
}

json settleJson(const procedures::FollowFigures& figures) {
  json times = json::array();
  for (const std::optional<double>& time : figures.settle) times.push_back(toJson(time));
  return times;
}

// If K_eps of the arm is unknown, forces are only known relative to it.
json alarmsJson(const FollowResult& result) {
  json alarms = json::array();
  for (const procedures::FollowAlarm& alarm : result.alarms) {
    alarms.push_back(
        {{"time_s", alarm.time},
         {"onset_s", alarm.onset},
         {alarm.normalised ? "force_per_K_eps" : "force_n", toJson(Eigen::VectorXd(alarm.force))},
         {"covariance", rowsJson(alarm.covariance)}});
  }
  return alarms;
}

json spreadJson(const char* name, const estimation::TipSpread& spread) {
  return {
      {"name", name}, {"sd_m", spread.deviation()}, {"covariance_m2", rowsJson(spread.covariance)}};
}

json budgetJson(const std::optional<estimation::TipErrorBudget>& budget) {
  if (!budget) return nullptr;
  json parts = json::array();
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const auto part = static_cast<estimation::BudgetPart>(i);
    parts.push_back(spreadJson(nameOf(part), budget->part(part)));
  }
  parts.push_back(spreadJson("predicted", budget->predicted));
  parts.push_back(spreadJson("open_loop", budget->open_loop));
  return {{"time_s", budget->time},
          {"parts", parts},
          {"error_m", toJson(Eigen::VectorXd(budget->error))},
          {"distance2", budget->distance2},
          {"limit", budget->limit},
          {"state", nameOf(budget->state)}};
}

void appendPosition(const std::string& prefix, const std::optional<Eigen::Vector3d>& position,
                    CsvTable::Row& row) {
  const char* const axes[] = {"x_m", "y_m", "z_m"};
  for (int i = 0; i < 3; ++i) {
    row.emplace_back(prefix + axes[i], position ? exact((*position)[i]) : std::string());
  }
}

CsvTable::Row cellsOf(const FollowRow& row, const model::Arm& arm) {
  CsvTable::Row cells{{"time_s", exact(row.time)}};
  appendPosition("wanted_", row.wanted, cells);
  appendPosition("true_", row.true_tip, cells);
  cells.emplace_back("measured_time_s", row.measured ? exact(row.measured_time) : std::string());
  appendPosition("measured_", row.measured, cells);
  appendPosition("predicted_", row.predicted, cells);
  appendInputs(arm, row.pressure, cells);
  cells.emplace_back("state", nameOf(row.state));
  return cells;
}

std::string millimetres(double metres) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(2) << 1e3 * metres << " mm";
  return text.str();
}

// "path RMS 0.43 mm" or "RMS of the last seconds 0.20 mm"
std::string summary(const procedures::FollowFigures& figures) {
  if (figures.path_rms) return "RMS " + millimetres(*figures.path_rms);
  double square = 0.0;
  int reachable = 0;
  for (std::size_t k = 0; k < figures.steady_rms.size(); ++k) {
    if (figures.unreachable[k]) continue;
    square += figures.steady_rms[k] * figures.steady_rms[k];
    ++reachable;
  }
  if (reachable == 0) return "";
  return "steady RMS " + millimetres(std::sqrt(square / reachable));
}

void printTips(const procedures::FollowFigures& figures) {
  for (std::size_t k = 0; k < figures.steady_rms.size(); ++k) {
    std::cout << "tip " << k + 1 << ": ";
    if (figures.unreachable[k]) {
      std::cout << "out of reach; " << millimetres(figures.steady_rms[k]) << " from it\n";
      continue;
    }
    std::cout << "steady RMS " << millimetres(figures.steady_rms[k]) << ", ";
    if (figures.settle[k]) {
      std::cout << "settled after " << std::fixed << std::setprecision(2) << *figures.settle[k]
                << " s\n";
    } else {
      std::cout << "did not settle\n";
    }
  }
}

// Rows that count for the figures: all, or those of the path.
std::vector<const FollowRow*> drawnRows(const procedures::FollowPlan& plan,
                                        const FollowResult& result) {
  std::vector<const FollowRow*> rows;
  for (const FollowRow& row : result.rows) {
    if (!row.wanted) continue;
    const bool on_path = row.path_time && *row.path_time >= 0 &&
                         (!plan.path || *row.path_time <= plan.path->lastTime());
    if (!plan.path || on_path) rows.push_back(&row);
  }
  const std::size_t stride = rows.size() / kMostDrawn + 1;
  std::vector<const FollowRow*> drawn;
  for (std::size_t k = 0; k < rows.size(); k += stride) drawn.push_back(rows[k]);
  return drawn;
}

json runJson(const char* name, const procedures::FollowPlan& plan, const FollowResult& result) {
  json times = json::array(), tips = json::array(), errors = json::array();
  for (const FollowRow* row : drawnRows(plan, result)) {
    times.push_back(row->time);
    tips.push_back(toJson(Eigen::VectorXd(row->true_tip)));
    errors.push_back((row->true_tip - *row->wanted).norm());
  }
  const std::string figure = summary(result.figures);
  return {{"name", figure.empty() ? name : name + (": " + figure)},
          {"time_s", times},
          {"tip_m", tips},
          {"error_m", errors}};
}

}  // namespace

std::string failureOf(const FollowReport& report) {
  if (!report.result.vented.empty()) return "the arm was vented: " + report.result.vented;
  if (report.plan.path && !report.result.figures.path_rms) {
    return "the time ended before the tip had reached the path's first point; raise "
           "--seconds";
  }
  return {};
}

json toJson(const FollowReport& report) {
  const procedures::FollowFigures& figures = report.result.figures;
  const std::string failure = failureOf(report);
  const auto nullable = [](const std::string& text) { return text.empty() ? json() : json(text); };
  return {{"scene", report.scene.name},
          {"rig", nullable(report.rig)},
          {"seed", report.plan.seed},
          {"sight", visionName(report.plan)},
          {"open", report.plan.open},
          {"seconds", report.plan.seconds},
          {"pictures", report.result.pictures},
          {"reason", nullable(failure)},
          {"path_rms_m", toJson(figures.path_rms)},
          {"path_max_m", toJson(figures.path_max)},
          {"steady_rms_m", figures.steady_rms},
          {"settle_s", settleJson(figures)},
          {"unreachable", figures.unreachable},
          {"states", statesJson(report.result)},
          {"alarms", alarmsJson(report.result)},
          {"budget", budgetJson(report.result.budget)},
          {"out", nullable(report.out)},
          {"png", nullable(report.png)}};
}

std::string csvOf(const FollowReport& report) {
  std::ostringstream out;
  out << "# Simulated run of scene " << report.scene.name << ", loop "
      << (report.plan.open ? "open" : "closed") << ", sight " << visionName(report.plan)
      << ", seed " << report.plan.seed
      << ". Tips seen from the arm's base. A measured tip is in the\n# row in which it became "
         "known; measured_time_s is the time of its picture.\n";
  bool named = false;
  for (const FollowRow& row : report.result.rows) {
    const CsvTable::Row cells = cellsOf(row, report.scene.arm);
    if (!named) CsvTable::printNames(cells, out);
    named = true;
    CsvTable::printValues(cells, out);
  }
  return out.str();
}

void printText(const FollowReport& report) {
  const procedures::FollowFigures& figures = report.result.figures;
  std::cout << report.scene.name << ", " << (report.plan.open ? "open" : "closed") << " loop, "
            << visionName(report.plan) << ", " << report.plan.seconds << " s, "
            << report.result.pictures << " pictures\n";
  if (figures.path_rms) {
    std::cout << "path: RMS " << millimetres(*figures.path_rms) << ", largest error "
              << millimetres(*figures.path_max) << "\n";
  }
  printTips(figures);
  std::cout << "states:";
  for (const procedures::FollowState& change : report.result.states) {
    std::cout << " " << nameOf(change.state) << " from " << std::fixed << std::setprecision(2)
              << change.time << " s" << (&change == &report.result.states.back() ? "\n" : ",");
  }
  if (const auto& budget = report.result.budget) {
    std::cout << "standard deviation of the predicted tip "
              << millimetres(budget->predicted.deviation()) << ", of the open loop's "
              << millimetres(budget->open_loop.deviation()) << "\n";
  }
  const std::string failure = failureOf(report);
  if (!failure.empty()) std::cout << failure << "\n";
}

json plotOf(const FollowReport& report, const FollowResult* open) {
  json wanted = json::array();
  for (const FollowRow* row : drawnRows(report.plan, report.result)) {
    wanted.push_back(toJson(Eigen::VectorXd(*row->wanted)));
  }
  json runs = json::array();
  if (open != nullptr) runs.push_back(runJson("open loop", report.plan, *open));
  runs.push_back(
      runJson(report.plan.open ? "open loop" : "closed loop", report.plan, report.result));
  const auto& blind = report.plan.blind;
  return {{"scene", report.scene.name},
          {"follow",
           {{"wanted_m", wanted},
            {"along_path", report.plan.path.has_value()},
            {"blind_s", blind ? json({blind->lower, blind->upper}) : json()},
            {"runs", runs}}}};
}

}  // namespace helix_arm::cli
