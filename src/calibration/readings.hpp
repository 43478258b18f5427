#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <vector>

#include "calibration_checks.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "localization/twist_equations.hpp"
#include "parameter_blocks.hpp"
#include "shape_model.hpp"

/// State that the costs of a calibration share, and the arm and lengths of each.
namespace helix_arm::estimation {

// Data that all costs share.
struct Shared {
  const std::vector<ArmCaptures>& arms;
  const CalibrationOptions& options;
  Selection selection;
  const std::vector<ArmCaptures> states;  // see statesOf()
  ShapeModel model;
  // (captures) shapes of the model before the search, for free shapes: the deviations of a
  // section's pieces from its mean are the model's.
  std::vector<model::Shape> expected_shapes;
  TwistFitOptions expected;  // noise of tags
  int held_tag;              // index of the tag that defines the reference frame

  Shared(const std::vector<ArmCaptures>& all, const CalibrationOptions& wanted,
         const Selection& chosen)
      : arms(all),
        options(wanted),
        selection(chosen),
        states(statesOf(all)),
        model(states, chosen.stiffness),
        held_tag(all.front().layout.baseTag()) {
    expected.corner_noise = options.corner_noise;
    expected.position_noise = options.position_noise;
    expected.rotation_noise = options.rotation_noise;
  }

  int scales() const { return lengthScales(selection, arms.front().arm); }
  double scaleOf(const Eigen::VectorXd& logs, int actuator) const {
    if (logs.size() == 0) return 1;
    return std::exp(logs[logs.size() == 1 ? 0 : actuator]);
  }
};

// Arm, capture and lengths of readings.
struct Place {
  int arm, capture;          // capture: index over all arms
  Eigen::VectorXd lengths;   // at its pressures [m]
  Eigen::VectorXd rest;      // at the lower end of the curves [m]
  std::vector<int> entries;  // free entries of the twists, for free shapes
  // Derivatives of lengths and rest (actuators x numbers of the curve), if one is fitted [m].
  Eigen::MatrixXd by_curve, rest_by_curve;
  int state;  // of Shared::states

  // With these values of the curve's numbers.
  Eigen::VectorXd lengthsAt(const Eigen::VectorXd& curve) const {
    if (by_curve.size() == 0) return lengths;
    return lengths + by_curve * curve;
  }
  Eigen::VectorXd restAt(const Eigen::VectorXd& curve) const {
    if (by_curve.size() == 0) return rest;
    return rest + rest_by_curve * curve;
  }
};

Place placeAt(const Shared& shared, int arm, int capture, const Eigen::VectorXd& pressure);

// The shape of a capture and, if the model determines it, its derivatives.
LinearisedShape shapeAt(Shared& shared, const Place& place, const Values& values, bool derivatives);

// Residuals of a calibration's readings, in expected standard deviations, and their derivatives.

// State that all readings of a capture share at given values of the parameters.
struct CaptureState {
  LinearisedShape shape;
  // The rest is for readings of tags.
  Corners corners;
  std::vector<lie::SE3> starts;  // X_B0j of the pieces
  // With derivatives: motion of the whole arm with the base, and beyond each piece with its twist.
  std::vector<PointJacobian> base, whole;
};

// Columns of a term: where the derivatives with respect to each parameter block begin, or -1.
struct TermColumns {
  int stiffness = -1, scale = -1, stroke = -1, curve = -1, shape = -1, base = -1, border_shift = -1,
      tag = -1;
  int count = 0;
};

class ReadingCost {
 public:
  // @param place  must outlive the cost.
  // @param rig  the blocks that the cost depends on, besides those of the shape.
  ReadingCost(const Shared& shared, const Place& place, int residuals,
              const std::set<ParameterBlock>& rig)
      : shared_(shared), place_(place), residuals_(residuals) {
    const auto take = [this](ParameterBlock kind, int size, int& first) {
      if (!shared_.selection.has(kind)) return;
      first = columns_.count;
      columns_.count += size;
      kinds_.push_back(kind);
    };
    const auto takeOfRig = [&](ParameterBlock kind, int size, int& first) {
      if (rig.count(kind) > 0) take(kind, size, first);
    };
    take(ParameterBlock::kStiffness, static_cast<int>(shared.selection.stiffness.size()),
         columns_.stiffness);
    take(ParameterBlock::kLengthScale, shared.scales(), columns_.scale);
    take(ParameterBlock::kStrokeScale, static_cast<int>(place_.lengths.size()), columns_.stroke);
    take(ParameterBlock::kCurve, static_cast<int>(place_.by_curve.cols()), columns_.curve);
    take(ParameterBlock::kShape, static_cast<int>(place_.entries.size()), columns_.shape);
    takeOfRig(ParameterBlock::kBase, 6, columns_.base);
    takeOfRig(ParameterBlock::kBorderShift, 1, columns_.border_shift);
    takeOfRig(ParameterBlock::kTag, 6, columns_.tag);
  }
  virtual ~ReadingCost() = default;
  ReadingCost(const ReadingCost&) = delete;
  ReadingCost& operator=(const ReadingCost&) = delete;

  // Its parameter blocks in the order of its columns.
  const std::vector<ParameterBlock>& kinds() const { return kinds_; }
  const Place& place() const { return place_; }
  int residuals() const { return residuals_; }
  int columns() const { return columns_.count; }
  virtual int tag() const { return -1; }

  // False if it has no residuals there.
  // @param J  (residuals x columns); null: without derivatives, which the state then lacks, too.
  // @param by_pieces  workspace.
  virtual bool evaluate(const CaptureState& state, const Values& values, Eigen::VectorXd& residual,
                        Eigen::MatrixXd* J, Eigen::MatrixXd& by_pieces) const = 0;
  // The error for reports. @param square  of its residuals.
  virtual double shown(const CaptureState& state, const Values& values, double square) const = 0;

 protected:
  // Converts derivatives with respect to mean twists to derivatives with respect to the pieces,
  // whose sums are the mean twists.
  static Eigen::MatrixXd overPieces(const Eigen::MatrixXd& by_twists, const model::Shape& shape) {
    Eigen::MatrixXd out(by_twists.rows(), shape.pieces().size());
    for (int j = 0; j < shape.pieces().cols(); ++j) {
      out.middleCols<6>(6 * j) = by_twists.middleCols<6>(6 * (j / shape.piecesPerSection()));
    }
    return out;
  }

  // Converts derivatives with respect to the pieces' twists to derivatives with respect to the
  // parameter blocks. Uses as many rows as there are residuals.
  void passOn(const Eigen::MatrixXd& by_pieces, const LinearisedShape& shape,
              Eigen::MatrixXd& J) const {
    J.resize(residuals_, columns_.count);
    const auto block = [&](int first, const Eigen::MatrixXd& derivatives) {
      if (first < 0) return;
      J.middleCols(first, derivatives.cols()).noalias() =
          by_pieces.topRows(residuals_).lazyProduct(derivatives);
    };
    block(columns_.stiffness, shape.by_stiffness);
    block(columns_.scale, shape.by_scale);
    block(columns_.stroke, shape.by_stroke);
    block(columns_.curve, shape.by_curve);
    if (columns_.shape < 0) return;
    // Each piece takes an equal part of a mean twist.
    const int per_section = shape.shape.piecesPerSection();
    for (std::size_t i = 0; i < place_.entries.size(); ++i) {
      auto out = J.col(columns_.shape + static_cast<int>(i));
      out.setZero();
      const int first = place_.entries[i] / 6 * per_section;
      for (int j = first; j < first + per_section; ++j) {
        out += by_pieces.col(6 * j + place_.entries[i] % 6).head(residuals_) / per_section;
      }
    }
  }

  const Shared& shared_;
  const Place& place_;
  TermColumns columns_;

 private:
  const int residuals_;
  std::vector<ParameterBlock> kinds_;
};

// Readings of captures as terms of the least-squares problem.

struct ReadingTerm {
  std::unique_ptr<ReadingCost> cost;
  std::vector<int> blocks;  ///< indices of its parameter blocks, in the order of its columns
  /// Squared residuals beyond which the reading is an outlier; infinite for twists, whose
  /// covariance is given.
  double limit = std::numeric_limits<double>::infinity();

  bool isRobust() const { return limit < std::numeric_limits<double>::infinity(); }
  /// Part of the robust sum of squares (Cauchy) that a square contributes.
  double loss(double square) const;
  /// Weight of a square from the robust loss, its derivative, in (0, 1].
  double weight(double square) const { return 1 / (1 + square / limit); }
};

/// The terms of one reading.
///
/// @param place  must outlive them.
std::vector<ReadingTerm> termsOf(const Shared& shared, const Place& place, const Reading& reading,
                                 const ParameterBlocks& blocks);

/// State that the readings of a capture share at these values.
///
/// @param kind  of its readings.
CaptureState stateAt(Shared& shared, const Place& place, ReadingKind kind, const Values& values,
                     bool derivatives);

/// The readings that an arm is expected to give at the pressures of a place: those of its captures,
/// each tag once, if it faces the camera.
///
/// @param place  must outlive them. @param state  there, at the current values.
std::vector<ReadingTerm> expectedTerms(const Shared& shared, const Place& place,
                                       const CaptureState& state, const ParameterBlocks& blocks);

}  // namespace helix_arm::estimation
