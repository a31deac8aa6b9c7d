# What keeps a mistake in the handling of a stranger's file from becoming more than a crash: guarded stacks, checked copies, addresses that
# nobody can foresee, and no function pointers to write over. Sanitizers check more, and get in each other's way with these.
if(LIGHTSTAGE_SANITIZE)
  return()
endif()

include(CheckCXXCompilerFlag)
foreach(flag -fstack-protector-strong -fstack-clash-protection -fcf-protection)
  string(MAKE_C_IDENTIFIER "HAS_${flag}" has)
  check_cxx_compiler_flag(${flag} ${has})
  if(${has})
    add_compile_options(${flag})
  endif()
endforeach()
add_compile_options($<$<CONFIG:Release,RelWithDebInfo>:-U_FORTIFY_SOURCE> $<$<CONFIG:Release,RelWithDebInfo>:-D_FORTIFY_SOURCE=2>)

# CMAKE_POSITION_INDEPENDENT_CODE makes position-independent code, and with this also programs that are loaded anywhere.
include(CheckPIESupported)
check_pie_supported(LANGUAGES CXX)
add_link_options(-Wl,-z,relro,-z,now,-z,noexecstack)
