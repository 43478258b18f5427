// Zones that an arm keeps out of, as scenes describe them.
#include <cstdint>
#include <cstring>
#include <fstream>

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

const std::string kZones = R"(keep_out:
  - {name: post, cylinder: {radius_m: 0.05, length_m: 1, position_m: [3, 0, 0.5], rpy_deg: [0, 90, 0]}, from_m: 0.1}
  - half_space: {position_m: [0, 0, -5], normal: [0, 0, 2]}
  - sphere: {radius_m: 0.1, position_m: [0, 5, 0]}
  - box: {size_m: [0.1, 0.2, 0.3], position_m: [1, 2, 3]}
clearance_m: 0.02
)";

TEST(KeepOut, IsOfTheWorldsFrame) {
  const Scene scene = sceneOf(kSpatialScene + kZones);
  ASSERT_TRUE(scene.keep_out);
  const clearance::KeepOut& found = *scene.keep_out;
  EXPECT_EQ(found.clearance, 0.02);
  EXPECT_EQ(found.X_WB.translation, scene.X_WB.translation);
  EXPECT_EQ(found.radii, (std::vector<double>{0.04, 0.03}));  // of the separators
  ASSERT_EQ(found.zones.size(), 4u);
  const clearance::Zone& post = found.zones[0];
  EXPECT_EQ(post.name, "post");
  EXPECT_EQ(post.from, 0.1);
  EXPECT_EQ(std::get<clearance::Cylinder>(post.form).radius, 0.05);
  EXPECT_EQ(post.X_WZ.translation, Eigen::Vector3d(3, 0, 0.5));
  EXPECT_LT((post.X_WZ.rotation.col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-15);
  EXPECT_EQ(found.zones[1].name, "half_space_2");
  EXPECT_LT((found.zones[1].X_WZ.rotation.col(2) - Eigen::Vector3d::UnitZ()).norm(), 1e-15);
  EXPECT_EQ(std::get<clearance::Sphere>(found.zones[2].form).radius, 0.1);
  EXPECT_EQ(std::get<clearance::Box>(found.zones[3].form).size, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(found.zones[3].X_WZ.translation, Eigen::Vector3d(1, 2, 3));
}

TEST(KeepOut, AToolMayHaveABody) {
  const Scene scene =
      sceneOf(kSpatialScene + kZones,
              {{"arm.tool",
                "{position_m: [0.1, 0, 0], body: {cylinder: {radius_m: 0.01, length_m: 0.1, "
                "position_m: [-0.05, 0, 0], rpy_deg: [0, 90, 0]}}}"}});
  ASSERT_TRUE(scene.keep_out->tool);
  EXPECT_EQ(std::get<clearance::Cylinder>(scene.keep_out->tool->form).length, 0.1);
  EXPECT_EQ(scene.keep_out->tool->X_TB.translation, Eigen::Vector3d(-0.05, 0, 0));
  EXPECT_EQ(scene.arm.tool().translation, Eigen::Vector3d(0.1, 0, 0));
}

// Two triangles that share an edge, as STL tells them.
const std::string kText = R"(solid two
facet normal 0 0 1
 outer loop
  vertex 0 0 0.5
  vertex 1 0 0.5
  vertex 0 1 0.5
 endloop
endfacet
facet normal 0 0 1
 outer loop
  vertex 1 0 0.5
  vertex 1 1 0.5
  vertex 0 1 0.5
 endloop
endfacet
endsolid two
)";

std::string binaryStl() {
  std::string bytes(80, 's');
  const std::uint32_t count = 2;
  bytes.append(reinterpret_cast<const char*>(&count), sizeof count);
  const float corners[2][9] = {{0, 0, 0.5F, 1, 0, 0.5F, 0, 1, 0.5F},
                               {1, 0, 0.5F, 1, 1, 0.5F, 0, 1, 0.5F}};
  for (const auto& triangle : corners) {
    bytes.append(12, '\0');
    bytes.append(reinterpret_cast<const char*>(triangle), sizeof triangle);
    bytes.append(2, '\0');
  }
  return bytes;
}

TEST(KeepOut, AMeshIsAnStlFileBesideTheScene) {
  const TemporaryFolder folder;
  const std::string scene = folder / "rig.yaml";
  std::ofstream(scene) << kSpatialScene << "keep_out: [{name: frame, mesh: frame.stl}]\n";
  for (const std::string& content : {kText, binaryStl()}) {
    std::ofstream(folder / "frame.stl", std::ios::binary) << content;
    const Scene loaded = loadScene(scene);
    const auto& mesh = std::get<clearance::Mesh>(loaded.keep_out->zones[0].form);
    EXPECT_EQ(mesh.corners.size(), 4u);
    ASSERT_EQ(mesh.triangles.size(), 2u);
    EXPECT_EQ(mesh.corners[static_cast<std::size_t>(mesh.triangles[1][1])],
              Eigen::Vector3d(1, 1, 0.5));
  }
  // The text of the scene finds it from elsewhere, too.
  EXPECT_EQ(sceneOfText(sceneText(scene), "copy").keep_out->zones.size(), 1u);
  for (const std::string& content :
       {std::string("solid none\nendsolid"), binaryStl().substr(0, 150), std::string("vertex 1 2"),
        replaced(kText, "vertex 1 1", "vertex 1000 1")}) {
    std::ofstream(folder / "frame.stl", std::ios::binary) << content;
    EXPECT_THROW(loadScene(scene), DocumentError) << content;
  }
  std::remove((folder / "frame.stl").c_str());
  EXPECT_THROW(loadScene(scene), DocumentError);
}

}  // namespace
}  // namespace helix_arm::io
