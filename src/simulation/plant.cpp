#include "helix_arm/simulation/plant.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <optional>

#include <sys/wait.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::simulation {
namespace {

using nlohmann::json;

constexpr std::chrono::milliseconds kPatience(9'500);  // for a line; 10 s with what ends it
constexpr int kEndPatience = 200;                      // for how it ended [ms]
constexpr std::size_t kLongestLine = 1U << 20U;
constexpr double kUnitError = 1e-3;                  // of a quaternion's norm
constexpr double kFarthest = 1e3;                    // of a pose from the base [m]
constexpr int kFewestPieces = 12, kMostPieces = 25;  // of a section
constexpr double kSamePlace = 1e-9;
constexpr const char* kRemedy = "; run it alone to see why (protocol: docs/closed_loop.md)";

// Pieces of each section, so that as many tags as possible are at their ends.
int piecesFor(const model::Arm& arm, const std::vector<estimation::TagPlacement>& tags) {
  const int most = std::min(kMostPieces, model::kMaxPieces / arm.sectionCount());
  int best = most;
  std::size_t most_at_ends = 0;
  for (int pieces = std::min(kFewestPieces, most); pieces <= most; ++pieces) {
    std::size_t at_ends = 0;
    for (const estimation::TagPlacement& tag : tags) {
      const double place = tag.s * pieces;
      if (std::abs(place - std::round(place)) < kSamePlace) ++at_ends;
    }
    if (at_ends <= most_at_ends) continue;
    best = pieces;
    most_at_ends = at_ends;
  }
  return best;
}

std::string endOf(const std::optional<int>& status) {
  if (!status) return "closed its output";
  if (WIFSIGNALED(*status)) return std::string("ended with ") + strsignal(WTERMSIG(*status));
  return "ended with exit code " + std::to_string(WEXITSTATUS(*status));
}

std::optional<Eigen::VectorXd> numbersOf(const json& given, Eigen::Index count) {
  if (!given.is_array() || given.size() != static_cast<std::size_t>(count)) return std::nullopt;
  Eigen::VectorXd out(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const json& number = given[static_cast<std::size_t>(i)];
    if (!number.is_number()) return std::nullopt;
    out[i] = number.get<double>();
  }
  return out.allFinite() ? std::optional(out) : std::nullopt;
}

std::optional<lie::SE3> poseOf(const json& given) {
  if (!given.is_object()) return std::nullopt;
  const auto position = numbersOf(given.value("position_m", json()), 3);
  const auto xyzw = numbersOf(given.value("quaternion_xyzw", json()), 4);
  if (!position || !xyzw || position->norm() > kFarthest) return std::nullopt;
  if (std::abs(xyzw->norm() - 1) > kUnitError) return std::nullopt;
  const Eigen::Quaterniond rotation(Eigen::Vector4d(xyzw->normalized()));
  return lie::SE3{rotation.toRotationMatrix(), *position};
}

}  // namespace

Plant::Plant(const std::string& command, const model::Arm& arm,
             const std::vector<estimation::TagPlacement>& tags)
    : command_(command),
      arm_(arm),
      pieces_(piecesFor(arm, tags)),
      process_({"/bin/sh", "-c", command}) {
  json names = json::array(), places = json::array();
  for (int i = 0; i < arm_.actuatorCount(); ++i) names.push_back(arm_.actuator(i).name);
  for (int k = 0; k < arm_.sectionCount(); ++k) {
    for (int j = 1; j <= pieces_; ++j) places.push_back({k, static_cast<double>(j) / pieces_});
  }
  const json first{
      {"protocol", 1}, {"actuators", names}, {"sections", arm_.sectionCount()}, {"places", places}};
  takePoses(ask(first.dump()), true);
}

void Plant::step(double dt, const Eigen::VectorXd& pressure, const Eigen::Vector3d& tip_force) {
  json turn{{"dt_s", dt}, {"pressure_pa", json::array()}, {"force", nullptr}};
  for (const double one : pressure) turn["pressure_pa"].push_back(one);
  if (!tip_force.isZero(0)) {
    turn["force"] = {{"section", arm_.sectionCount() - 1},
                     {"s", 1.0},
                     {"force_n", {tip_force.x(), tip_force.y(), tip_force.z()}}};
  }
  takePoses(ask(turn.dump()), false);
}

std::string Plant::ask(const std::string& line) {
  using Clock = std::chrono::steady_clock;
  process_.send(line + "\n");  // if it reads no more, it has ended, or is silent
  for (const auto end = Clock::now() + kPatience;;) {
    const auto line_end = received_.find('\n');
    if (line_end != std::string::npos) {
      std::string answer = received_.substr(0, line_end);
      received_.erase(0, line_end + 1);
      return answer;
    }
    if (received_.size() > kLongestLine) refuse("sent a line of more than 1 MB");
    char bytes[4096];
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now());
    const auto count = process_.read(bytes, sizeof bytes, static_cast<int>(left.count()));
    if (!count) refuse("was silent for 10 s");
    if (*count == 0) refuse(endOf(process_.status(kEndPatience)));
    received_.append(bytes, *count);
  }
}

void Plant::takePoses(const std::string& answer, bool first) {
  const json given = json::parse(answer, nullptr, false);
  const auto broken = [&](const std::string& rule) {
    refuse("answered \"" + basics::quoted(answer, 80) + "\"; expected " + rule);
  };
  if (!given.is_object()) broken("one JSON object in a line");
  if (first && given.value("ready", json()) != true) broken("\"ready\": true in the first line");
  const json poses = given.value("poses", json());
  const int count = arm_.sectionCount() * pieces_;
  if (!poses.is_array() || poses.size() != static_cast<std::size_t>(count)) {
    broken(basics::messageOf("\"poses\" with one pose for each of the ", count, " places"));
  }
  model::Shape::Pieces pieces(6, count);
  lie::SE3 begin;
  for (int j = 0; j < count; ++j) {
    const auto pose = poseOf(poses[static_cast<std::size_t>(j)]);
    if (!pose) {
      broken(basics::messageOf("in pose ", j,
                               " of \"poses\" a position_m of 3 finite numbers "
                               "within 1 km and a quaternion_xyzw of norm 1"));
    }
    const bool tip = j + 1 == count;
    const lie::SE3 link = arm_.link(j / pieces_);
    const lie::SE3 end = tip ? *pose * link.inverse() : *pose;
    pieces.col(j) = (begin.inverse() * end).log();
    begin = (j + 1) % pieces_ == 0 ? end * link : end;
  }
  shape_ = model::Shape(pieces, pieces_, arm_.links());
}

void Plant::refuse(const std::string& fault) const {
  throw PlantError("plant \"" + basics::quoted(command_, 200) + "\" " + fault + kRemedy);
}

}  // namespace helix_arm::simulation
