# near(WHAT BOX TRUTH): fails where the numbers of the lists, whole pixels, are more than 4 apart.
function(near what box truth)
  foreach(value expected IN ZIP_LISTS box truth)
    math(EXPR off "${value} - ${expected}")
    if(off GREATER 4 OR off LESS -4)
      message(FATAL_ERROR "${what} is ${box}, and not ${truth}")
    endif()
  endforeach()
endfunction()
