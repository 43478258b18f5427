#pragma once

#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/printed_page.hpp"
#include "helix_arm/procedures/unrolled_tags.hpp"

namespace helix_arm::procedures {

/// Lays out the drawings and tables of placementSheets() from the top down, over as many pages as
/// they need.
class PlacementSheet {
 public:
  /// @param scene  kept by reference.
  PlacementSheet(const io::Scene& scene, const std::vector<UnrolledTag>& tags, const Paper& paper);

  const std::vector<Page>& pages() const { return pages_; }

 private:
  void addSection(int section);
  void addTable(const std::vector<UnrolledTag>& tags);
  void addRow(const std::vector<std::string>& cells, bool bold);
  void addLegend();
  void beginPage();
  double roomLeft() const;  // below what is there already [mm]

  const io::Scene& scene_;
  std::vector<UnrolledTag> tags_;
  Paper paper_;
  std::vector<Page> pages_;
  double y_ = 0.0;  // where the next part begins [mm]
};

}  // namespace helix_arm::procedures
