#include "readings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>
#include <variant>

namespace helix_arm::estimation {
namespace {

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

double ReadingTerm::loss(double square) const {
  return isRobust() ? limit * std::log1p(square / limit) : square;
}

std::vector<ReadingTerm> termsOf(const Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks) {
  const ArmCaptures& data = shared.arms[place.arm];
  std::vector<ReadingTerm> terms;
  const auto add = [&](std::unique_ptr<ReadingCost> cost) {
    const double scale = shared.options.robust_scale * std::sqrt(cost->residuals());
    std::vector<int> own = blocksOf(*cost, blocks);
    terms.push_back({std::move(cost), std::move(own), scale * scale});
  };
  const auto addTags = [&](const auto& model, const auto& observations) {
    using Model = std::decay_t<decltype(model)>;
    for (const auto& seen : observations) {
      const bool free = seen.tag != shared.held_tag;
      add(std::make_unique<TagCost<Model>>(shared, place, model, seen, free));
    }
  };
  if (const auto* curvature = std::get_if<CurvatureReading>(&reading)) {
    add(std::make_unique<CurvatureCost>(shared, place, curvature->curvature));
  } else if (const auto* twists = std::get_if<TwistReading>(&reading)) {
    add(std::make_unique<TwistCost>(shared, place, *twists));
    terms.back().limit = std::numeric_limits<double>::infinity();
  } else if (const auto* poses = std::get_if<std::vector<PoseObservation>>(&reading)) {
    addTags(PoseModel{shared.expected}, *poses);
  } else {
    const CornerModel model{data.X_CB, data.camera.focal() / shared.options.corner_noise,
                            shared.expected};
    addTags(model, std::get<std::vector<CornerObservation>>(reading));
  }
  return terms;
}

CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind, const Values& values,
                     bool derivatives) {
  CaptureState state;
  state.shape = shapeAt(shared, place, values, derivatives);
  if (!isMet(FitNeed::kTags, kind)) return state;
  const model::Shape& shape = state.shape.shape;
  const lie::Vector6 base = values.own_blocks.at(ParameterBlock::kBase);
  state.corners =
      shared.arms[place.arm].layout.corners(values.own_blocks.at(ParameterBlock::kBorderShift)[0]);
  lie::SE3 X_B0j = lie::SE3::exp(base);
  const int pieces = static_cast<int>(shape.pieces().cols());
  for (int j = 0; j < pieces; ++j) {
    state.starts.push_back(X_B0j);
    if (j + 1 < pieces) X_B0j = shape.beyond(X_B0j, j);
  }
  if (!derivatives) return state;
  if (shared.selection.has(ParameterBlock::kBase)) state.base.emplace_back(lie::SE3(), base, 1.0);
  for (int j = 0; j + 1 < pieces; ++j) {
    state.whole.emplace_back(state.starts[j], shape.pieces().col(j), 1.0);
  }
  return state;
}

std::vector<ReadingTerm> expectedTerms(const Shared& shared, const Place& place,
                                       const CaptureState& state, const ParameterBlocks& blocks) {
  const ArmCaptures& arm = shared.arms[place.arm];
  std::vector<ReadingTerm> terms;
  std::vector<bool> seen(arm.layout.tags.size(), false);
  const auto add = [&](const Reading& reading) {
    for (ReadingTerm& term : termsOf(shared, place, reading, blocks)) {
      if (const auto* tag = dynamic_cast<const TagCost<CornerModel>*>(term.cost.get())) {
        if (!tag->faces(state, blocks.values())) continue;
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

void addInformation(const ReadingTerm& term, const ParameterBlocks& blocks, const double* J,
                    double weight, Eigen::MatrixXd& H) {
  const int columns = term.cost->columns();
  const Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>> jacobian(
      J, term.cost->residuals(), columns, Eigen::OuterStride<>(term.cost->stride()));
  const Eigen::MatrixXd square = weight * (jacobian.transpose() * jacobian);
  int i = 0;
  for (const int row : term.blocks) {
    const ParameterBlocks::Block& a = blocks.all()[row];
    int j = 0;
    for (const int column : term.blocks) {
      const ParameterBlocks::Block& b = blocks.all()[column];
      H.block(a.column, b.column, a.size(), b.size()) += square.block(i, j, a.size(), b.size());
      j += b.size();
    }
    i += a.size();
  }
}

}  // namespace helix_arm::estimation
