#include "linearised_readings.hpp"

#include <algorithm>
#include <limits>

namespace helix_arm::estimation {

LinearisedReadings::LinearisedReadings(Shared& shared, ReadingKind kind,
                                       const std::vector<Place>& places,
                                       const std::vector<ReadingTerm>& terms)
    : shared_(shared),
      kind_(kind),
      places_(places),
      terms_(terms),
      first_term_(places.size() + 1, terms.size()),
      known_(places.size(), kNothing),
      states_(places.size()),
      squares_(terms.size(), 0.0) {
  std::size_t residuals = 0, entries = 0;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const ReadingCost& cost = *terms[t].cost;
    const auto capture = static_cast<std::size_t>(cost.place().capture);
    first_term_[capture] = std::min(first_term_[capture], t);
    first_residual_.push_back(residuals);
    first_entry_.push_back(entries);
    residuals += static_cast<std::size_t>(cost.residuals());
    entries += static_cast<std::size_t>(cost.residuals() * cost.stride());
  }
  for (std::size_t c = places.size(); c-- > 0;) {
    first_term_[c] = std::min(first_term_[c], first_term_[c + 1]);
  }
  residuals_.resize(residuals);
  jacobians_.resize(entries, 0.0);
}

void LinearisedReadings::update(const Values& values, const Eigen::VectorXd& numbers,
                                const Included& included, bool derivatives) {
  if (at_.size() != numbers.size() || at_ != numbers) {
    std::fill(known_.begin(), known_.end(), kNothing);
    at_ = numbers;
  }
  const Known wanted = derivatives ? kDerivatives : kResiduals;
  for (int c = 0; c < static_cast<int>(places_.size()); ++c) {
    if (known_[c] < wanted && included(c)) evaluate(c, values, derivatives);
  }
}

void LinearisedReadings::evaluate(int capture, const Values& values, bool derivatives) {
  CaptureState& state = states_[capture];
  state = stateAt(shared_, places_[capture], kind_, values, derivatives);
  for (std::size_t t = first_term_[capture]; t < first_term_[capture + 1]; ++t) {
    const ReadingCost& cost = *terms_[t].cost;
    double* const residual = &residuals_[first_residual_[t]];
    double* const jacobian = derivatives ? &jacobians_[first_entry_[t]] : nullptr;
    const bool found =
        state.shape.found && cost.evaluate(state, values, residual, jacobian, by_pieces_);
    squares_[t] = std::numeric_limits<double>::infinity();
    if (found) {
      squares_[t] = Eigen::Map<const Eigen::VectorXd>(residual, cost.residuals()).squaredNorm();
    }
    for (int r = 0; derivatives && r < cost.residuals(); ++r) {
      jacobian[r * cost.stride() + cost.columns()] = residual[r];
    }
  }
  known_[capture] = derivatives ? kDerivatives : kResiduals;
}

}  // namespace helix_arm::estimation
