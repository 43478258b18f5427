#pragma once

#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"

namespace helix_arm::cli {

/// What one way to compute, draw or measure the arm's shape costs, and how far it is off.
struct TradeRow {
  std::string part;     ///< model, curve, sight or fit: rows of one part compete with each other
  std::string tier;     ///< of the part
  std::string setting;  ///< of the tier; empty where it has none
  double time;          ///< median of one answer [s]
  double error;         ///< as a part of the arm's length; infinite where there is no answer
  bool on_frontier = false;
};

/// Marks the rows that no other row of their part beats in time without being worse in error.
void markFrontier(std::vector<TradeRow>& rows);

/// Every tier and order: largest error of the tip against the exact tier, at sampled inputs. No
/// rows where the load finds no balance at any of them.
std::vector<TradeRow> modelRows(const io::Scene& scene);

/// Curves and tubes of muscles drawn from ever more points: largest distance of what is drawn from
/// what is meant.
std::vector<TradeRow> drawingRows(const io::Scene& scene);

/// Every way to search a picture, and to fit the shape to what it found: median error of the tip
/// over rendered pictures of the moving arm, against the true one. No rows where the scene's tier
/// finds no shape at any picture.
/// @param pictures  > 0; of a scene with camera and tags.
std::vector<TradeRow> visionRows(const io::Scene& scene, int pictures);

}  // namespace helix_arm::cli
