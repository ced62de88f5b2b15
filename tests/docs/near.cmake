# near(WHAT BOX TRUTH): fails if two corresponding numbers of the lists, whole pixels, differ by more than 4.
function(near what box truth)
  foreach(value expected IN ZIP_LISTS box truth)
    math(EXPR off "${value} - ${expected}")
    if(off GREATER 4 OR off LESS -4)
      message(FATAL_ERROR "${what} is ${box}, and not ${truth}")
    endif()
  endforeach()
endfunction()
