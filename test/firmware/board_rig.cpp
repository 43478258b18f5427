#include "board_rig.hpp"

#include <cmath>

#include "helix_arm/regulator/regulator_io.hpp"

namespace helix_arm::test {
namespace {

using control::SafetyState;

// As config/regulators/generic.yaml, except for times by the wall clock: the board's is another.
regulator::SerialProfile profileOfBoard() {
  regulator::SerialProfile profile = genericProfile();
  profile.timeout = 0.5;
  return profile;
}

std::vector<std::string> addressesOf(int channels) {
  std::vector<std::string> addresses;
  for (int i = 0; i < channels; ++i) addresses.push_back(std::to_string(i));
  return addresses;
}

control::SafetyCore coreOf(int channels) {
  control::SafetyRules rules;
  rules.target_timeout = 0.5;
  rules.reading_timeout = 0.4;
  rules.spike_time = 0.1;
  rules.follow_tolerance = 3e4;
  rules.follow_time = 0.4;
  rules.time_constant = 0.1;
  std::vector<control::ChannelRules> all;
  for (int i = 0; i < channels; ++i) {
    all.push_back({"muscle_" + std::to_string(i + 1), {0, 3e5}, 5e5, {}});
  }
  return {all, rules};
}

}  // namespace

BoardRig::BoardRig(const BoardKind& kind)
    : board_(kind),
      driver_({profileOfBoard(), board_.path(), addressesOf(kind.channels())}, kind.channels()),
      core_(coreOf(kind.channels())),
      goal_(Eigen::VectorXd::Zero(kind.channels())) {
  core_.linked(0, false);
  board_.pass(0.1);
}

void BoardRig::lose() {
  try {
    driver_.vent();
  } catch (const std::runtime_error&) {
    // A board whose answers are lost may hear all the same.
  }
  driver_.close();
  up_ = false;
}

void BoardRig::exchange() {
  regulator::Pressures pressures(static_cast<int>(goal_.size()));
  try {
    if (!up_) driver_.connect();
    up_ = true;
    driver_.write(core_.orders());
    driver_.read(pressures);
    bad_in_a_row_ = 0;
  } catch (const regulator::BadReply& error) {
    error_ = error.what();
    if (++bad_in_a_row_ >= regulator::IoRules().most_bad_replies) lose();
  } catch (const regulator::LinkError& error) {
    error_ = error.what();
    lose();
  }
  core_.linked(board_.time(), up_);
  core_.measured(board_.time(), pressures.pressure);
}

void BoardRig::turn() {
  exchange();
  core_.target(board_.time(), goal_);
  core_.advance(board_.time());
  board_.pass(kTurn);
}

bool BoardRig::reaches(SafetyState state, double longest) {
  const double end = board_.time() + longest;
  while (core_.state() != state && board_.time() < end) turn();
  return core_.state() == state;
}

std::string BoardRig::bringTo(double goal) {
  constexpr double kLongest = 5, kNear = 5e3;
  setGoal(goal);
  const double end = board_.time() + kLongest;
  while (core_.state() != SafetyState::kEnabled) {
    turn();
    const std::string refusal = core_.enable(board_.time());
    if (!refusal.empty() && board_.time() > end) return refusal + "; " + error_;
  }
  const auto isThere = [&] {
    return with([&](const SimulatedBoard& board) {
      for (int i = 0; i < board.channels(); ++i) {
        if (std::abs(board.pressure(i) - goal) > kNear) return false;
      }
      return true;
    });
  };
  while (!isThere()) {
    turn();
    if (state() != SafetyState::kEnabled) return core_.reason() + "; " + error_;
    if (board_.time() > end) return "the muscles do not come to the goal";
  }
  return "";
}

}  // namespace helix_arm::test
