#pragma once

#include <string>

#include "helix_arm/io/pressure_history.hpp"
#include "helix_arm/io/scene.hpp"
#include "output.hpp"

namespace helix_arm::cli {

/// The text of an option `--history` of a subcommand.
inline constexpr char kHistoryHelp[] =
    "data set with the measured pressures in the order taken: pressure_1_kpa, .., and optionally "
    "time_s and trial; the arm's response follows them";

/// The history of a file. @throws CallerError if the arm has tendons, io::DocumentError on faults.
model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path);

/// What a result without history leaves out; empty for an arm without responses.
std::string noteOnResponse(const model::Arm& arm);

/// Adds `response` {history_rows, memory_known, half_width_pa, uncertainty_pa, note} to a result;
/// nothing for an arm without responses.
/// @param rows  of the history; 0 without one.
void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 nlohmann::json& result);

}  // namespace helix_arm::cli
