#include "contact_proof.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <stdexcept>

#include "basics/text.hpp"
#include "calibration_job.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/io/calibrated_scene.hpp"
#include "helix_arm/tracking/tip_compliance.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kRest = 4.0;                    // after a move [s]
constexpr double kShortestMove = 0.5;            // [s]
constexpr double kSlewPart = 0.5;                // of what a path may use
constexpr int kPieces = 20;                      // of a move
constexpr double kLowest = 0.1, kHighest = 0.9;  // of the pressures' ranges
constexpr int kMostDraws = 1000;                 // of a shape that balances the load

// A force must exceed by a half what motion alone looks like; scores are its square.
constexpr double kMargin = 2.0;
constexpr double kLeastWatched = 60.0;  // [s]
constexpr double kMostForce = 1.0;      // that a watch must find [N]
constexpr double kNineInTen = 1.28;     // standard deviations

// A motion of all pressures that begins and ends at rest.
struct Move {
  Eigen::VectorXd to;                 // (n) pressures at its end [Pa]
  double duration;                    // [s]
  std::vector<Eigen::Vector3d> tips;  // after each of its pieces, base frame [m]
};

// Nothing if a shape on its way does not balance the load.
std::optional<Move> moveBetween(const io::Scene& scene, const Eigen::VectorXd& from,
                                const Eigen::VectorXd& to) {
  const double top_rate = 1.5 * (to - from).cwiseAbs().maxCoeff();  // half way, of 1 s
  const double most = kSlewPart * follow::kSlewShare * scene.follow.slew;
  Move out{to, std::max(kShortestMove, top_rate / most), {}};
  for (int j = 1; j <= kPieces; ++j) {
    const double x = static_cast<double>(j) / kPieces;
    const statics::Tip tip = scene.model.tip(from + x * x * (3 - 2 * x) * (to - from));
    if (!tip.converged()) return std::nullopt;
    out.tips.push_back(tip.tip.translation);
  }
  return out;
}

// To a random shape; without `from`, a rest there.
Move drawMove(const io::Scene& scene, const std::optional<Eigen::VectorXd>& from,
              std::mt19937_64& generator) {
  std::uniform_real_distribution<double> part(kLowest, kHighest);
  for (int k = 0; k < kMostDraws; ++k) {
    Eigen::VectorXd parts(scene.arm.actuatorCount());
    for (double& one : parts) one = part(generator);
    const Eigen::VectorXd to = scene.arm.inputAt(parts);
    if (auto move = moveBetween(scene, from.value_or(to), to)) return *std::move(move);
  }
  throw std::invalid_argument("no shape of " + scene.name + " that was drawn balances its load; " +
                              "expected a load that the arm holds at most pressures");
}

// Text on a force across the tip [N].
std::string foundText(const ContactProof& proof) {
  const double K_eps = estimation::TipCompliance::kTypicalStiffness;
  return basics::format("a force of %.2g N across the resting tip",
                        proof.force * (proof.normalised ? K_eps : 1)) +
         (proof.normalised ? basics::format(" of an arm with K_eps %g N", K_eps) : "") +
         " is found within 0.5 s in 9 of 10 cases";
}

}  // namespace

control::TipPath quietPath(const io::Scene& scene, double seconds, std::uint32_t seed) {
  std::mt19937_64 generator(seed);
  Move move = drawMove(scene, std::nullopt, generator);
  std::vector<control::TipWayPoint> points;
  double time = 0.0;
  const auto rest = [&](double until) {
    points.push_back({time, move.tips.back(), {}, Eigen::Vector3d(0, 0, 0)});
    time = until;
    points.push_back({time, move.tips.back(), {}, Eigen::Vector3d(0, 0, 0)});
  };
  rest(kRest);
  while (time < seconds) {
    const Eigen::Vector3d begin = move.tips.back();
    move = drawMove(scene, move.to, generator);
    const double piece = move.duration / kPieces;
    for (std::size_t j = 0; j + 1 < move.tips.size(); ++j) {
      const Eigen::Vector3d& before = j == 0 ? begin : move.tips[j - 1];
      time += piece;
      points.push_back({time, move.tips[j], {}, (move.tips[j + 1] - before) / (2 * piece)});
    }
    time += piece;
    rest(time + kRest);
  }
  return control::TipPath(points);
}

ContactProof contactProof(const io::Scene& scene, const estimation::QuietScore& quiet) {
  const double limit =
      std::max(estimation::OnsetOptions{}.limit, std::ceil(kMargin * quiet.highest));
  ContactProof out{quiet, limit, follow::OnContact::kReport, "", 0.0, !scene.model.load()};
  const double force = (std::sqrt(out.limit) + kNineInTen) * quiet.unit_force;
  out.force = out.normalised ? force / estimation::TipCompliance::kTypicalStiffness : force;
  if (quiet.seconds < kLeastWatched) {
    out.doubt = basics::format(
        "contacts could have been found for %.0f s; expected at least %.0f s at rest and seen: "
        "let it run for longer, with the arm in sight",
        quiet.seconds, kLeastWatched);
  } else if (force > kMostForce) {
    out.doubt = foundText(out) + basics::format(
                                     "; expected at most %g N: calibrate the arm, and "
                                     "tell the response of its muscles",
                                     kMostForce);
  } else {
    const bool stops = scene.follow.on_contact == follow::OnContact::kStop;
    out.on_contact = stops ? follow::OnContact::kStop : follow::OnContact::kYield;
  }
  return out;
}

std::string provenSceneText(const std::string& path, const std::vector<io::Override>& overrides,
                            const ContactProof& proof) {
  const std::string title = basics::format(
      "# follow.contact_limit and follow.on_contact are of a proof at %s, for %.0f s without\n"
      "# contact: the highest score was %.1f. %s.\n",
      utcNow().c_str(), proof.quiet.seconds, proof.quiet.highest,
      (proof.doubt.empty() ? foundText(proof) : "Not proven: " + proof.doubt).c_str());
  return io::sceneTextWithContacts(path, overrides, proof.limit, proof.on_contact, title);
}

}  // namespace helix_arm::procedures
