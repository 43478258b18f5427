#include "helix_arm/model/contraction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

using Polynomial = std::vector<double>;  // ascending powers

[[noreturn]] void refuse(const std::string& what, double value, const std::string& rule) {
  throw std::invalid_argument(what + " is " + basics::format("%.10g", value) + "; expected " +
                              rule);
}

void requirePositive(const std::string& what, double value) {
  if (!(std::isfinite(value) && value > 0)) refuse(what, value, "a finite value > 0");
}

double evaluate(const Polynomial& c, double u) {
  double sum = 0.0;
  for (std::size_t k = c.size(); k-- > 0;) sum = sum * u + c[k];
  return sum;
}

Polynomial derivative(const Polynomial& c) {
  Polynomial d;
  for (std::size_t k = 1; k < c.size(); ++k) d.push_back(static_cast<double>(k) * c[k]);
  return d;
}

// Sign changes of the polynomial inside (lo, hi), ascending: at most one between adjacent extrema.
std::vector<double> signChanges(const Polynomial& c, double lo, double hi) {
  std::vector<double> roots;
  if (c.size() < 2) return roots;
  std::vector<double> edges = signChanges(derivative(c), lo, hi);
  edges.insert(edges.begin(), lo);
  edges.push_back(hi);
  double from = lo;
  double sign = 0.0;  // of the last non-zero edge: a double root is not a sign change
  for (const double edge : edges) {
    const double value = evaluate(c, edge);
    if (value == 0) continue;
    if (value * sign < 0) {
      double a = from, b = edge;
      for (double m = 0.5 * (a + b); a < m && m < b; m = 0.5 * (a + b)) {
        (evaluate(c, m) * sign > 0 ? a : b) = m;
      }
      roots.push_back(b);
    }
    from = edge;
    sign = value > 0 ? 1.0 : -1.0;
  }
  return roots;
}

// Slope at a table's end from three points, without overshooting (Fritsch and Carlson 1980).
double endSlope(double h0, double h1, double secant0, double secant1) {
  const double slope = ((2 * h0 + h1) * secant0 - h0 * secant1) / (h0 + h1);
  if (slope * secant0 <= 0) return 0.0;
  if (secant0 * secant1 < 0 && std::abs(slope) > 3 * std::abs(secant0)) return 3 * secant0;
  return slope;
}

}  // namespace

Contraction::Contraction(double rest_length, std::vector<Piece> pieces, Range input_range)
    : rest_length_(rest_length), pieces_(std::move(pieces)), input_range_(input_range) {
  const double first = lengthInside(input_range_.lower);
  const double last = lengthInside(input_range_.upper);
  rising_ = last > first;
  length_range_ = {std::min(first, last), std::max(first, last)};
}

Contraction Contraction::quintic(const std::array<double, 6>& coefficients,
                                 double reference_pressure, double max_pressure) {
  requirePositive("reference_pressure", reference_pressure);
  requirePositive("max_pressure", max_pressure);
  for (std::size_t k = 0; k < coefficients.size(); ++k) {
    if (!std::isfinite(coefficients[k])) {
      refuse("coefficient c" + std::to_string(k), coefficients[k], "a finite value");
    }
  }
  const Polynomial slope = derivative(Polynomial(coefficients.begin(), coefficients.end()));
  const double u_max = max_pressure / reference_pressure;
  const std::vector<double> turns = signChanges(slope, 0.0, u_max);
  if (!turns.empty()) {
    refuse("the pressure where the length reverses", turns.front() * reference_pressure,
           "a length that is monotone up to the maximum pressure");
  }
  if (std::all_of(slope.begin(), slope.end(), [](double c) { return c == 0; })) {
    refuse("the slope of the length", 0.0, "a length that changes with pressure");
  }
  std::array<double, 6> change = coefficients;
  change[0] = 0.0;
  Contraction curve(coefficients[0], {{0.0, 1.0 / reference_pressure, change}},
                    {0.0, max_pressure});
  requirePositive("the smallest length", curve.length_range_.lower);
  return curve;
}

Contraction Contraction::table(const std::vector<double>& pressure,
                               const std::vector<double>& length) {
  const std::size_t n = pressure.size();
  if (n < 2 || length.size() != n) {
    refuse("the number of lengths", static_cast<double>(length.size()),
           "one per pressure, at least 2 (pressures: " + std::to_string(n) + ")");
  }
  std::vector<double> h(n - 1), secant(n - 1);
  for (std::size_t i = 0; i < n; ++i) {
    const std::string point = " of point " + std::to_string(i + 1);
    if (!std::isfinite(pressure[i])) refuse("pressure" + point, pressure[i], "a finite value");
    requirePositive("length" + point, length[i]);
    if (i == 0) continue;
    h[i - 1] = pressure[i] - pressure[i - 1];
    if (!(h[i - 1] > 0)) refuse("pressure" + point, pressure[i], "a value above the previous one");
    secant[i - 1] = (length[i] - length[i - 1]) / h[i - 1];
    if (!(secant[i - 1] * secant[0] > 0)) {
      refuse("length" + point, length[i], "lengths that all fall or all rise");
    }
  }
  std::vector<double> slope(n);
  for (std::size_t i = 1; i + 1 < n; ++i) {
    // Weighted harmonic mean of the neighbours' secants.
    const double w0 = 2 * h[i] + h[i - 1], w1 = h[i] + 2 * h[i - 1];
    slope[i] = (w0 + w1) / (w0 / secant[i - 1] + w1 / secant[i]);
  }
  slope[0] = n == 2 ? secant[0] : endSlope(h[0], h[1], secant[0], secant[1]);
  slope[n - 1] = n == 2 ? secant[0] : endSlope(h[n - 2], h[n - 3], secant[n - 2], secant[n - 3]);

  std::vector<Piece> pieces;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double rise = length[i + 1] - length[i];
    const double m0 = h[i] * slope[i], m1 = h[i] * slope[i + 1];
    pieces.push_back(
        {pressure[i],
         1.0 / h[i],
         {length[i] - length[0], m0, 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise, 0, 0}});
  }
  return Contraction(length[0], std::move(pieces), {pressure.front(), pressure.back()});
}

Contraction Contraction::tendon(double length, double radius, double max_angle) {
  requirePositive("length", length);
  requirePositive("radius", radius);
  requirePositive("max_angle", max_angle);
  requirePositive("the smallest length", length - radius * max_angle);
  return Contraction(length, {{0.0, 1.0, {0, -radius, 0, 0, 0, 0}}}, {0.0, max_angle});
}

Contraction Contraction::scaledBy(double factor, double stroke) const {
  requirePositive("factor", factor);
  requirePositive("the factor on the stroke", stroke);
  std::vector<Piece> pieces = pieces_;
  for (Piece& piece : pieces) {
    for (double& c : piece.coefficients) c *= factor * stroke;
  }
  Contraction out(factor * rest_length_, std::move(pieces), input_range_);
  requirePositive("the smallest length", out.length_range_.lower);
  return out;
}

double Contraction::length(double q) const {
  if (!input_range_.contains(q)) {
    throw std::out_of_range(basics::messageOf("input ", q, " is outside [", input_range_.lower,
                                              ", ", input_range_.upper, "]"));
  }
  return lengthInside(q);
}

double Contraction::slope(double q) const {
  static_cast<void>(length(q));  // with the same range check
  return slopeInside(q);
}

double Contraction::slopeInside(double q) const noexcept {
  const Piece& piece = pieceAt(q);
  const double u = (q - piece.start) * piece.inverse_scale;
  const auto& c = piece.coefficients;
  return ((((5 * c[5] * u + 4 * c[4]) * u + 3 * c[3]) * u + 2 * c[2]) * u + c[1]) *
         piece.inverse_scale;
}

double Contraction::inverse(double length) const {
  if (!length_range_.contains(length)) {
    throw std::out_of_range(basics::messageOf("length ", length, " m is outside [",
                                              length_range_.lower, ", ", length_range_.upper,
                                              "] m"));
  }
  return inverseInside(length, 0.5 * (input_range_.lower + input_range_.upper));
}

double Contraction::inverseInside(double length, double guess) const noexcept {
  // Halley's method, with bisection if it would leave the bracket. It converges cubically (across a
  // knot quadratically), so the error after a step this small is below rounding.
  double lower = input_range_.lower, upper = input_range_.upper;
  const double small_step = (pieces_.size() == 1 ? 3e-6 : 1e-9) * (upper - lower);
  double q = std::min(std::max(guess, lower), upper);
  for (int i = 0; i < 100; ++i) {
    const Piece& piece = pieceAt(q);
    const auto& c = piece.coefficients;
    const double u = (q - piece.start) * piece.inverse_scale, u2 = u * u;
    const double error = lengthInside(q) - length;
    if (error == 0) return q;
    ((error > 0) == rising_ ? upper : lower) = q;
    const double slope = (c[1] + 2 * c[2] * u) + u2 * ((3 * c[3] + 4 * c[4] * u) + 5 * c[5] * u2);
    const double half_bend = (c[2] + 3 * c[3] * u) + u2 * (6 * c[4] + 10 * c[5] * u);
    double next = q - error * slope / ((slope * slope - error * half_bend) * piece.inverse_scale);
    const bool inside = next >= lower && next <= upper;
    if (!inside) next = 0.5 * (lower + upper);
    // Convergence is only linear where the slope nearly vanishes.
    const bool cubic = inside && std::abs(error * half_bend) <= 3e-5 * slope * slope;
    const double last_bit = std::numeric_limits<double>::epsilon() * upper;
    if (std::abs(next - q) <= (cubic ? small_step : last_bit)) return next;
    q = next;
  }
  return q;
}

}  // namespace helix_arm::model
