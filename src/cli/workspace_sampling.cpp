#include "workspace_sampling.hpp"

#include <algorithm>
#include <deque>
#include <future>
#include <thread>
#include <utility>

#include "helix_arm/basics/median.hpp"
#include "interrupt_watch.hpp"
#include "workspace_progress.hpp"

namespace helix_arm::cli {
namespace {

// Number of points kept for medians and maps. The samples are evenly distributed, so the first ones
// represent all.
constexpr std::size_t kMostKept = 2000000;

void add(const statics::WorkspacePoints& points, bool keep, WorkspaceSummary& summary) {
  summary.inputs += static_cast<std::uint64_t>(points.count() + points.unbalanced);
  summary.unbalanced += static_cast<std::uint64_t>(points.unbalanced);
  if (points.count() == 0) return;
  summary.sampled.add(points);
  const bool sensitive = points.sensitivity.rows() > 0;
  if (sensitive) {
    summary.worst =
        summary.worst.cwiseMax(points.sensitivity.colwise().maxCoeff().transpose()).eval();
  }
  for (int row = 0; keep && row < points.count() && summary.kept.size() < kMostKept; ++row) {
    CloudPoint point{points.tips.row(row), Eigen::Vector3d::Zero()};
    if (sensitive) point.sensitivity = points.sensitivity.row(row);
    summary.kept.push_back(point);
  }
}

}  // namespace

double WorkspaceSummary::median(int k) const {
  std::vector<double> values;
  for (const CloudPoint& point : kept) values.push_back(point.sensitivity[k]);
  return basics::medianOf(std::move(values));
}

WorkspaceSummary sampleWorkspace(const statics::Workspace& workspace,
                                 const WorkspaceArguments& arguments, CloudFile* file) {
  struct Piece {
    statics::WorkspacePoints points;
    std::string encoded;
  };
  const std::uint64_t total = arguments.inputs();
  const int size = workspace.pieceSize();  // small enough to react to Ctrl-C soon
  const auto make = [&workspace, file, total, size](std::uint64_t first) {
    const auto count = static_cast<int>(std::min<std::uint64_t>(total - first, size));
    Piece piece{workspace.sample(first, count), {}};
    if (file != nullptr) piece.encoded = file->encode(piece.points);
    return piece;
  };
  const std::size_t threads = arguments.threads > 0
                                  ? static_cast<std::size_t>(arguments.threads)
                                  : std::max(1u, std::thread::hardware_concurrency());
  WorkspaceSummary summary;
  Progress progress(total);
  std::deque<std::future<Piece>> pieces;
  std::uint64_t begun = 0;
  while (!interrupted() && summary.inputs < total) {
    while (begun < total && pieces.size() < threads) {
      pieces.push_back(std::async(std::launch::async, make, begun));
      begun += static_cast<std::uint64_t>(size);
    }
    const Piece piece = pieces.front().get();
    pieces.pop_front();
    if (file != nullptr) {
      file->write(piece.encoded, static_cast<std::uint64_t>(piece.points.count()));
    }
    add(piece.points, arguments.sensitivity || !arguments.png.empty(), summary);
    progress.reached(summary.inputs);
  }
  summary.whole = !interrupted();
  if (file != nullptr && summary.whole && summary.points() > 0) file->finish();
  summary.seconds = progress.seconds();
  return summary;
}

}  // namespace helix_arm::cli
