#include "reading_terms.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>
#include <variant>

namespace helix_arm::estimation {
namespace {

template <class Observation>
std::unique_ptr<ReadingCost> tagCost(Shared& shared, const Place& place, const Observation& seen) {
  const ArmCaptures& data = shared.arms[place.arm];
  const bool free = seen.tag != shared.held_tag;
  if constexpr (std::is_same_v<Observation, CornerObservation>) {
    const CornerModel model{data.X_CB, data.focal / shared.options.corner_noise, shared.expected};
    return std::make_unique<TagCost<CornerModel>>(shared, place, model, seen, free);
  } else {
    return std::make_unique<TagCost<PoseModel>>(shared, place, PoseModel{shared.expected}, seen,
                                                free);
  }
}

std::vector<std::unique_ptr<ReadingCost>> costsOf(Shared& shared, const Place& place,
                                                  const Reading& reading) {
  std::vector<std::unique_ptr<ReadingCost>> costs;
  if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
    costs.push_back(std::make_unique<CurvatureCost>(shared, place, curvature->curvature));
  } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
    costs.push_back(std::make_unique<TwistCost>(shared, place, *twists));
  } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
    for (const PoseObservation& seen : *poses) costs.push_back(tagCost(shared, place, seen));
  } else {
    for (const CornerObservation& seen : std::get<std::vector<CornerObservation>>(reading)) {
      costs.push_back(tagCost(shared, place, seen));
    }
  }
  return costs;
}

std::vector<int> blocksOf(const ReadingCost& cost, const ParameterBlocks& blocks) {
  std::vector<int> indices;
  for (const ParameterBlock kind : cost.kinds()) {
    int of = 0;
    if (kind == ParameterBlock::kTag) of = cost.tag();
    if (kind == ParameterBlock::kShape) of = cost.place().capture;
    indices.push_back(blocks.indexOf(kind, of));
  }
  return indices;
}

}  // namespace

double ReadingTerm::square(const ParameterBlocks& all) const {
  Eigen::VectorXd residuals(cost->num_residuals());
  if (!cost->Evaluate(all.data(blocks).data(), residuals.data(), nullptr)) {
    return std::numeric_limits<double>::infinity();
  }
  return residuals.squaredNorm();
}

double ReadingTerm::weight(double square) const { return loss ? 1 / (1 + square / limit) : 1.0; }

std::vector<ReadingTerm> termsOf(Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks) {
  const bool robust = !std::holds_alternative<TwistReading>(reading);
  std::vector<ReadingTerm> terms;
  for (std::unique_ptr<ReadingCost>& cost : costsOf(shared, place, reading)) {
    ReadingTerm term;
    const double scale = shared.options.robust_scale * std::sqrt(cost->num_residuals());
    term.limit = scale * scale;
    if (robust) term.loss = std::make_unique<ceres::CauchyLoss>(scale);
    term.blocks = blocksOf(*cost, blocks);
    term.cost = std::move(cost);
    terms.push_back(std::move(term));
  }
  return terms;
}

std::vector<ReadingTerm> expectedTerms(Shared& shared, const ArmCaptures& arm,
                                       const Eigen::VectorXd& pressure,
                                       const ParameterBlocks& blocks) {
  const Place place = placeAt(shared, 0, 0, pressure);
  std::vector<ReadingTerm> terms;
  std::vector<bool> seen(arm.layout.tags.size(), false);
  const auto add = [&](const Reading& reading) {
    for (ReadingTerm& term : termsOf(shared, place, reading, blocks)) {
      if (const auto* tag = dynamic_cast<const TagCost<CornerModel>*>(term.cost.get())) {
        if (!tag->faces(blocks.data(term.blocks).data())) continue;
      }
      terms.push_back(std::move(term));
    }
  };
  const auto addNew = [&](const auto& observations) {
    auto fresh = observations;
    fresh.erase(std::remove_if(fresh.begin(), fresh.end(),
                               [&seen](const auto& one) {
                                 const bool known = seen[one.tag];
                                 seen[one.tag] = true;
                                 return known;
                               }),
                fresh.end());
    add(fresh);
  };
  for (const Capture& capture : arm.captures) {
    if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&capture.reading)) {
      addNew(*poses);
    } else if (const auto* corners =
                   std::get_if<std::vector<CornerObservation>>(&capture.reading)) {
      addNew(*corners);
    } else {
      add(capture.reading);
      break;
    }
  }
  return terms;
}

void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks,
                    const std::function<double(double)>& weigh, Eigen::MatrixXd& H) {
  const ReadingCost& cost = *term.cost;
  Eigen::VectorXd residuals(cost.num_residuals());
  std::vector<RowMajor> jacobians;
  std::vector<double*> pointers;
  for (const int size : cost.parameter_block_sizes()) {
    jacobians.emplace_back(cost.num_residuals(), size);
  }
  for (RowMajor& jacobian : jacobians) pointers.push_back(jacobian.data());
  if (!cost.Evaluate(blocks.data(term.blocks).data(), residuals.data(), pointers.data())) return;
  const double weight = weigh(residuals.squaredNorm());
  for (std::size_t i = 0; i < jacobians.size(); ++i) {
    const int row = blocks.all()[term.blocks[i]].column;
    for (std::size_t j = 0; j < jacobians.size(); ++j) {
      const int column = blocks.all()[term.blocks[j]].column;
      H.block(row, column, jacobians[i].cols(), jacobians[j].cols()) +=
          weight * (jacobians[i].transpose() * jacobians[j]);
    }
  }
}

}  // namespace helix_arm::estimation
