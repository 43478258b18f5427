# The folder that rosrun looks into holds the package's programs and nothing else: run with -DFOLDER=... -DEXPECTED=... -P.
cmake_minimum_required(VERSION 3.16)
file(GLOB found RELATIVE ${FOLDER} ${FOLDER}/*)
list(SORT found)
list(SORT EXPECTED)
if(NOT found STREQUAL EXPECTED)
  message(FATAL_ERROR "${FOLDER} holds ${found}; expected ${EXPECTED}. Remove what an earlier build left there")
endif()
