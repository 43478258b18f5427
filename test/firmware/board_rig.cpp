#include "board_rig.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <variant>

namespace helix_arm::test {
namespace {

using control::SafetyState;

// Except for a time by the wall clock: the board's is another.
regulator::SerialProfile profileOf(const io::Scene& scene) {
  regulator::SerialProfile profile = std::get<regulator::SerialConfig>(*scene.regulator).profile;
  profile.timeout = 0.3;
  profile.watchdog = std::numeric_limits<double>::infinity();
  return profile;
}

std::vector<std::string> addressesOf(int channels) {
  std::vector<std::string> addresses;
  for (int i = 0; i < channels; ++i) addresses.push_back(std::to_string(i));
  return addresses;
}

// Of a board with more channels than the scene, each is as the first.
control::SafetyCore coreOf(const io::Scene& scene, int channels) {
  std::vector<control::ChannelRules> all(static_cast<std::size_t>(channels),
                                         scene.safety.channels.front());
  for (std::size_t i = 0; i < all.size(); ++i) all[i].name = "muscle_" + std::to_string(i + 1);
  return {all, scene.safety.rules};
}

}  // namespace

BoardRig::BoardRig(const BoardKind& kind)
    : board_(kind),
      scene_(readScene(board_.path())),
      driver_({profileOf(scene_), board_.path(), addressesOf(kind.channels())}, kind.channels()),
      core_(coreOf(scene_, kind.channels())),
      goal_(Eigen::VectorXd::Zero(kind.channels())) {
  core_.linked(0, false);
  board_.pass(0.1);
}

void BoardRig::connect() {
  if (board_.time() < tries_at_) return;
  try {
    driver_.connect();
    up_ = true;
    bad_in_a_row_ = 0;
    back_off_ = regulator::IoRules().first_back_off;
  } catch (const regulator::LinkError& error) {
    error_ = error.what();
    driver_.close();
    tries_at_ = board_.time() + back_off_;
    back_off_ = std::min(2 * back_off_, regulator::IoRules().longest_back_off);
  }
}

void BoardRig::disconnect() {
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
  if (!up_) connect();
  try {
    if (up_) {
      driver_.write(core_.orders());
      driver_.read(pressures);
      bad_in_a_row_ = 0;
    }
  } catch (const regulator::BadReply& error) {
    error_ = error.what();
    if (++bad_in_a_row_ >= regulator::IoRules().most_bad_replies) disconnect();
  } catch (const regulator::LinkError& error) {
    error_ = error.what();
    disconnect();
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
