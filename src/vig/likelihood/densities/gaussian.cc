#define LOG_DENSITY(s) (-(s))
#define PULL(s) real(1)
