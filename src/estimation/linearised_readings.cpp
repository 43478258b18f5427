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
  std::size_t entries = 0;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const ReadingCost& cost = *terms[t].cost;
    const auto capture = static_cast<std::size_t>(cost.place().capture);
    first_term_[capture] = std::min(first_term_[capture], t);
    first_entry_.push_back(entries);
    entries += static_cast<std::size_t>(cost.residuals() * cost.stride());
  }
  for (std::size_t c = places.size(); c-- > 0;) {
    first_term_[c] = std::min(first_term_[c], first_term_[c + 1]);
  }
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
    residuals_.resize(static_cast<std::size_t>(cost.residuals()));
    double* const jacobian = derivatives ? &jacobians_[first_entry_[t]] : nullptr;
    squares_[t] = std::numeric_limits<double>::infinity();
    if (!state.shape.found ||
        !cost.evaluate(state, values, residuals_.data(), jacobian, by_pieces_)) {
      continue;
    }
    squares_[t] =
        Eigen::Map<const Eigen::VectorXd>(residuals_.data(), cost.residuals()).squaredNorm();
    for (int r = 0; derivatives && r < cost.residuals(); ++r) {
      jacobian[r * cost.stride() + cost.columns()] = residuals_[r];
    }
  }
  known_[capture] = derivatives ? kDerivatives : kResiduals;
}

}  // namespace helix_arm::estimation
