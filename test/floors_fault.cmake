# The check of the floors must see what it is for: run with -DROOT=<sources> -DSCRATCH=<folder> -P.
cmake_minimum_required(VERSION 3.16)
foreach(planted "\"ros/ros.h\"" "<ceres/ceres.h>" "\"../io/document.hpp\"" "<yaml-cpp/yaml.h>"
    "\"helix_arm/model/arm.hpp\"" "\"helix_arm/ArmShape.h\"")
  file(REMOVE_RECURSE ${SCRATCH})
  file(COPY ${ROOT}/include ${ROOT}/src DESTINATION ${SCRATCH})
  file(APPEND ${SCRATCH}/src/lie/se3.cpp "#include ${planted}\n")
  execute_process(COMMAND ${CMAKE_COMMAND} -DROOT=${SCRATCH} -P ${CMAKE_CURRENT_LIST_DIR}/floors.cmake
    RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE message)
  if(result EQUAL 0 OR NOT message MATCHES "src/lie/se3.cpp")
    message(FATAL_ERROR "${planted} in lie was not seen: ${message}")
  endif()
endforeach()
