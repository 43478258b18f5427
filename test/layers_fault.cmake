# The check of the layers must see what it is for: run with -DROOT=<sources> -DSCRATCH=<folder> -P.
cmake_minimum_required(VERSION 3.16)
set(checker ${CMAKE_CURRENT_LIST_DIR}/layers.cmake)

# expect_fault(FILE LINE): LINE, planted at the end of FILE, is seen.
function(expect_fault file line)
  file(REMOVE_RECURSE ${SCRATCH})
  file(COPY ${ROOT}/include ${ROOT}/src DESTINATION ${SCRATCH})
  file(APPEND ${SCRATCH}/${file} "${line}\n")
  execute_process(COMMAND ${CMAKE_COMMAND} -DROOT=${SCRATCH} -P ${checker}
    RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE message)
  if(result EQUAL 0 OR NOT message MATCHES "${file}")
    message(FATAL_ERROR "${line} in ${file} was not seen: ${message}")
  endif()
endfunction()

foreach(planted "\"ros/ros.h\"" "<ceres/ceres.h>" "\"../io/document.hpp\"" "<yaml-cpp/yaml.h>"
    "\"helix_arm/model/arm.hpp\"" "\"helix_arm/ArmShape.h\"" "\"ros_bridge/common/diagnostics.hpp\"")
  expect_fault(src/lie/se3.cpp "#include ${planted}")
endforeach()
expect_fault(src/ros_bridge/vision/observations.cpp "#include \"ros_bridge/pressure/target_admission.hpp\"")
expect_fault(src/model/arm.cpp "#include \"helix_arm/statics/load.hpp\"")
expect_fault(src/rviz_panel/cockpit_panel.cpp "#include <ros/time.h>")
expect_fault(src/stray.cpp "// a file outside the layers")
