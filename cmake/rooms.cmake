# lightstage_room(NAME PUBLIC <libraries seen in its headers> PRIVATE <libraries hidden inside> PRECOMPILE <headers>)
#
# A room is one static library made of every .cpp below its folder. Its headers are included as "room/header.h" through
# an include root that holds a link to this room alone, so that code which includes a header of a room it does not
# link does not compile. Headers at the top of the folder are public; those in folders below it are the room's own.

add_library(lightstage_warnings INTERFACE)
target_compile_options(lightstage_warnings INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor
                                                     -Woverloaded-virtual -Wimplicit-fallthrough
                                                     $<$<CXX_COMPILER_ID:GNU>:-Werror>  # others warn of other things
                                                     -Wno-missing-field-initializers)  # {.one = 1} leaves the rest at its default on purpose
# GCC 12 sees overlaps and overflows in inlined std::string concatenation that are not there (GCC bug 105651).
target_compile_options(lightstage_warnings INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds -Wno-restrict -Wno-stringop-overflow -Wno-stringop-overread>)
# Intermediate results keep float32/float64 as written, whatever the compiler would like to fuse: results must not
# depend on the optimisation level.
target_compile_options(lightstage_warnings INTERFACE -ffp-contract=off)

if(LIGHTSTAGE_SANITIZE)
  add_compile_options(-fsanitize=${LIGHTSTAGE_SANITIZE} -fno-omit-frame-pointer)
  add_link_options(-fsanitize=${LIGHTSTAGE_SANITIZE})
  if(LIGHTSTAGE_SANITIZE MATCHES "undefined")
    add_compile_options(-fno-sanitize-recover=all)
  endif()
endif()

function(lightstage_room room)
  cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE;PRECOMPILE" ${ARGN})
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  set(target lightstage_${room})
  add_library(${target} STATIC ${sources})
  add_library(Lightstage::${room} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${room} LINKER_LANGUAGE CXX)
  target_compile_features(${target} PUBLIC cxx_std_20)

  set(root ${PROJECT_BINARY_DIR}/rooms/${room})
  file(MAKE_DIRECTORY ${root})
  file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR} ${root}/${room} SYMBOLIC)
  target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${root}> $<INSTALL_INTERFACE:include/lightstage>)

  target_link_libraries(${target} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE} $<BUILD_INTERFACE:lightstage_warnings>)
  if(ARG_PRECOMPILE)
    target_precompile_headers(${target} PRIVATE ${ARG_PRECOMPILE})
  endif()

  file(GLOB headers CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.h)
  install(TARGETS ${target} EXPORT LightstageTargets ARCHIVE DESTINATION lib)
  install(FILES ${headers} DESTINATION include/lightstage/${room})
endfunction()
