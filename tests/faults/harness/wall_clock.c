/* Preloaded into a service: the system clock is off by as many seconds as the file CLOCK_OFFSET_FILE says. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>

static long offset_s(void)
{
    long seconds = 0;
    FILE *file = fopen(getenv("CLOCK_OFFSET_FILE"), "r");
    if (file != NULL) {
        if (fscanf(file, "%ld", &seconds) != 1)
            seconds = 0;
        fclose(file);
    }
    return seconds;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    static _Thread_local int is_inside;
    if (real == NULL)
        real = dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, now);
    if (clock == CLOCK_REALTIME && !is_inside) {
        static _Thread_local long known_s;
        static _Thread_local time_t read_s;
        if (read_s != now->tv_sec) {
            is_inside = 1;
            known_s = offset_s();
            is_inside = 0;
            read_s = now->tv_sec;
        }
        now->tv_sec += known_s;
    }
    return result;
}
