#pragma once

#include <vector>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/printed_page.hpp"
#include "helix_arm/vision/charuco_board.hpp"
#include "helix_arm/vision/tag_board.hpp"

namespace helix_arm::procedures {

/// The tags of a scene to cut out, each at its exact size with id, place on the arm, up mark and
/// cut line. Every page has two rulers of 100 mm that show whether the printer scaled it.
///
/// @param scene  with tags.
/// @throws std::invalid_argument on a scene without tags, or with tags too large for the paper.
std::vector<Page> tagSheets(const io::Scene& scene, const Paper& paper);

/// Where the tags are mounted: each section that has tags as if its skin were unrolled, and a table
/// of positions. Not to scale. @throws as tagSheets() on a scene without tags.
std::vector<Page> placementSheets(const io::Scene& scene, const Paper& paper);

/// A board for the calibration of a camera, at its exact size, with the rulers of tagSheets().
/// @throws std::invalid_argument on a board too large for the paper.
Page boardSheet(const vision::TagBoard& board, const Paper& paper);
/// @param board  valid. @throws likewise.
Page boardSheet(const vision::CharucoBoard& board, const Paper& paper);

/// Adds "page 1 of 3" and so on, in the order of the pages.
void numberPages(const Paper& paper, std::vector<Page>& pages);

}  // namespace helix_arm::procedures
