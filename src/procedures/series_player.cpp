#include "helix_arm/procedures/series_player.hpp"

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace helix_arm::procedures {

SeriesPlayer::SeriesPlayer(Eigen::MatrixXd rows, const Eigen::VectorXd& from,
                           const SeriesTiming& timing)
    : rows_(std::move(rows)), timing_(timing) {
  if (rows_.rows() < 1) throw std::invalid_argument("a series without rows; expected at least one");
  const double period = timing.ramp + timing.hold;
  if (!(timing.ramp >= 0 && timing.hold >= 0 && period > 0) || std::isinf(period)) {
    throw std::invalid_argument("a series with a ramp of " + std::to_string(timing.ramp) +
                                " s and a hold of " + std::to_string(timing.hold) +
                                " s; expected finite values >= 0, not both 0");
  }
  resume(from);
}

void SeriesPlayer::resume(const Eigen::VectorXd& from) {
  if (from.size() != rows_.cols()) {
    throw std::invalid_argument("a series of " + std::to_string(rows_.cols()) +
                                " actuators cannot begin at " + std::to_string(from.size()) +
                                " pressures");
  }
  from_ = from;
  time_ = 0.0;
}

void SeriesPlayer::advance(double dt) {
  time_ += dt;
  const double period = timing_.ramp + timing_.hold;
  while (!finished_ && time_ >= period) {
    const bool last = row_ + 1 == rows_.rows();
    if (last && !timing_.loop) {
      finished_ = true;
      return;
    }
    from_ = rows_.row(row_);
    row_ = last ? 0 : row_ + 1;
    time_ -= period;
  }
}

Eigen::VectorXd SeriesPlayer::pressure() const {
  Eigen::VectorXd to = rows_.row(row_);
  if (finished_ || time_ >= timing_.ramp) return to;
  return from_ + time_ / timing_.ramp * (to - from_);
}

}  // namespace helix_arm::procedures
