#include "basics/vector_clones.hpp"
#include "helix_arm/lie/se3.hpp"
#include "lie/coefficients.hpp"

namespace helix_arm::lie {
namespace {

// u.v with the additional eleven bits of the extended format.
long double extendedDot(double ux, double uy, double uz, double vx, double vy, double vz) {
  const long double x = ux, y = uy, z = uz;
  return x * vx + y * vy + z * vz;
}

}  // namespace

HELIX_ARM_CLONES
SE3 SE3::exp(const Tangent& xi) {
  const double vx = xi[0], vy = xi[1], vz = xi[2], wx = xi[3], wy = xi[4], wz = xi[5];
  // In doubles, |w|^2 would be the largest error, and w.v where the curve returns to its start.
  const long double square = extendedDot(wx, wy, wz, wx, wy, wz);
  const auto x = static_cast<double>(square);
  const auto [a, b, c, cosine] = expCoefficients(x, static_cast<double>(square - x));
  SE3 X;
  // R = cos I + a [w] + b w w'
  const double bx = b * wx, by = b * wy, bz = b * wz;
  const double ax = a * wx, ay = a * wy, az = a * wz;
  X.rotation << cosine + bx * wx, bx * wy - az, bx * wz + ay,  //
      bx * wy + az, cosine + by * wy, by * wz - ax,            //
      bx * wz - ay, by * wz + ax, cosine + bz * wz;
  // V v with w x (w x v) = w (w.v) - theta^2 v and 1 - c theta^2 = a: large angles cancel nothing.
  const double along =
      c * (x <= kSeriesLimit ? wx * vx + wy * vy + wz * vz
                             : static_cast<double>(extendedDot(wx, wy, wz, vx, vy, vz)));
  X.translation << a * vx + (by * vz - bz * vy) + along * wx,  //
      a * vy + (bz * vx - bx * vz) + along * wy,               //
      a * vz + (bx * vy - by * vx) + along * wz;
  return X;
}

}  // namespace helix_arm::lie
