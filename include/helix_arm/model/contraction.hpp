#pragma once

#include <array>
#include <vector>

namespace helix_arm::model {

/// A closed interval of an actuator's input or length.
struct Range {
  double lower = 0.0;
  double upper = 0.0;
  /// False for NaN.
  bool contains(double x) const { return x >= lower && x <= upper; }
};

/// Free length l(q) of an unloaded actuator [m] as a function of its input q: the gauge pressure of
/// a muscle [Pa] or the spool angle of a tendon [rad]. Strictly monotone on its range and never
/// extrapolated beyond it.
///
/// Every kind of curve is stored as polynomials between knots, so evaluation is the same for all.
class Contraction {
 public:
  /// The polynomial between two knots: the change of length since the lower end of the range.
  struct Piece {
    double start;          ///< lower end of the piece, in units of the input
    double inverse_scale;  ///< u = (q - start) * inverse_scale
    std::array<double, 6> coefficients;
  };

  /// l = sum_k c_k (p / p_ref)^k on [0, p_max].
  ///
  /// @param coefficients        c_0 .. c_5 [m].
  /// @param reference_pressure  p_ref > 0 [Pa]; the largest fitted pressure keeps it well
  ///     conditioned.
  /// @param max_pressure        p_max > 0 [Pa], the end of the measurements.
  /// @throws std::invalid_argument when an argument breaks its rule, or when the polynomial is not
  ///     monotone on its range, naming the pressure where it turns.
  static Contraction quintic(const std::array<double, 6>& coefficients, double reference_pressure,
                             double max_pressure);

  /// Monotone piecewise cubic (PCHIP, Fritsch and Carlson 1980) through given points.
  ///
  /// @param pressure  (n >= 2) ascending [Pa].
  /// @param length    (n) strictly monotone, > 0 [m].
  /// @throws std::invalid_argument naming the first point that breaks a rule.
  static Contraction table(const std::vector<double>& pressure, const std::vector<double>& length);

  /// A tendon on a spool: l = length - radius * q on [0, max_angle].
  ///
  /// @param length     free length at q = 0 [m].
  /// @param radius     spool radius > 0 [m].
  /// @param max_angle  > 0 [rad], with length - radius * max_angle > 0.
  /// @throws std::invalid_argument naming the argument that breaks its rule.
  static Contraction tendon(double length, double radius, double max_angle);

  /// The same curve with all lengths multiplied by a factor, after their distances from
  /// restLength() were multiplied by another: factor * (rest + stroke * (l - rest)).
  /// @param factor, stroke  > 0. @throws std::invalid_argument otherwise, or if a length is not >
  /// 0.
  Contraction scaledBy(double factor, double stroke = 1.0) const;

  /// The polynomials of the curve, in order of increasing input.
  const std::vector<Piece>& pieces() const { return pieces_; }
  /// Range on which the curve is defined, in units of the input.
  const Range& inputRange() const { return input_range_; }
  /// Range of the curve's lengths [m].
  const Range& lengthRange() const { return length_range_; }

  /// l(q) [m]. @throws std::out_of_range outside inputRange().
  double length(double q) const;
  /// dl/dq [m/Pa or m/rad]. @throws std::out_of_range outside inputRange().
  double slope(double q) const;
  /// The input q with l(q) = length, to the last bits. @throws std::out_of_range outside
  /// lengthRange().
  double inverse(double length) const;

  /// l(q) for a q that is known to be inside: no check, no exception.
  double lengthInside(double q) const noexcept { return rest_length_ + changeInside(q); }
  /// l(q) - restLength(), accurate to the last bits of the difference.
  double changeInside(double q) const noexcept {
    const Piece& piece = pieceAt(q);
    const double u = (q - piece.start) * piece.inverse_scale;
    const auto& c = piece.coefficients;
    const double u2 = u * u;  // pairs first (Estrin): half the latency of Horner's rule
    return (c[0] + c[1] * u) + u2 * ((c[2] + c[3] * u) + u2 * (c[4] + c[5] * u));
  }
  /// Length at the lower end of the range [m].
  double restLength() const { return rest_length_; }
  double slopeInside(double q) const noexcept;
  /// inverse() for a length that is known to be inside. A good first guess saves most of the time.
  double inverseInside(double length, double guess) const noexcept;

 private:
  Contraction(double rest_length, std::vector<Piece> pieces, Range input_range);
  const Piece& pieceAt(double q) const noexcept {
    const Piece* piece = pieces_.data();
    const Piece* last = piece + pieces_.size() - 1;
    while (piece != last && q >= piece[1].start) ++piece;
    return *piece;
  }

  double rest_length_;
  std::vector<Piece> pieces_;
  Range input_range_;
  Range length_range_;
  bool rising_ = false;  ///< dl/dq > 0, as for a bellows
};

}  // namespace helix_arm::model
