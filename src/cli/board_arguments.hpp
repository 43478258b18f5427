#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "command.hpp"
#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_board.hpp"
#include "nlohmann/json.hpp"

// The calibration board on the command line: a board of tags, or a ChArUco board.

namespace helix_arm::cli {

using CalibrationBoard = std::variant<vision::TagBoard, vision::CharucoBoard>;

struct BoardArguments {
  std::string kind;  ///< empty: no board is asked for
  std::string squares;
  std::optional<double> square_size, marker_size;
  std::string dictionary;
  bool legacy_pattern = false;

  bool given() const { return !kind.empty(); }
};

/// Adds --board KIND, which is tags unless given, and the options of a ChArUco board.
void addBoardOption(CLI::App& command, BoardArguments& arguments, const std::string& what);
/// Adds --board, which alone means tags, and the options of a ChArUco board.
void addBoardFlag(CLI::App& command, BoardArguments& arguments, const std::string& what);

/// The arguments of a call with a kind that follows --board as part of it, as a flag takes it.
std::vector<std::string> joinBoardKind(std::vector<std::string> arguments);

/// @throws CallerError on options of a ChArUco board without one.
void checkBoard(const BoardArguments& arguments);
/// @throws CallerError as checkBoard(), and naming the option that breaks a rule.
CalibrationBoard boardOf(const BoardArguments& arguments);

/// `board` of the reports: keys of either kind.
nlohmann::json boardJson(const CalibrationBoard& board);

}  // namespace helix_arm::cli
