# Installs a finished build to a folder of its own: run with -DBUILD=<build> -DSCRATCH=<folder> -P.
cmake_minimum_required(VERSION 3.16)
file(REMOVE_RECURSE ${SCRATCH})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${SCRATCH}
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "cmake --install ended with ${result}: ${message}")
endif()
string(REGEX MATCHALL "-- (Installing|Up-to-date): [^\n]*" lines "${output}")
if(NOT lines)
  message(FATAL_ERROR "cmake --install says nothing of what it installs: ${output}")
endif()
foreach(line IN LISTS lines)
  string(REGEX REPLACE "^-- [^:]*: " "" path "${line}")
  string(FIND "${path}" "${SCRATCH}/" at)
  if(NOT at EQUAL 0)
    message(FATAL_ERROR "installed outside of ${SCRATCH}: ${path}")
  endif()
endforeach()
# The setup file names the new prefix, for a shell that cannot know where a sourced file lies, too.
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env --unset=CMAKE_PREFIX_PATH --unset=ROS_PACKAGE_PATH
    sh -c ". \"$0/setup.sh\"; printf '%s|' \"$CMAKE_PREFIX_PATH\" \"$ROS_PACKAGE_PATH\"; \"$0/lib/helix_arm/helix_arm\" --version"
    ${SCRATCH}
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0 OR NOT output MATCHES "helix_arm [0-9]")
  message(FATAL_ERROR "the installed command ended with ${result}: ${output}${message}")
endif()
foreach(place "${SCRATCH}[:|]" "${SCRATCH}/share")
  if(NOT output MATCHES "${place}")
    message(FATAL_ERROR "setup.sh does not lead to ${place}: ${output}")
  endif()
endforeach()
file(REMOVE_RECURSE ${SCRATCH})
