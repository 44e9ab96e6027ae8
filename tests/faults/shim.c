/* SPDX-License-Identifier: MIT
 * Stands between a program and the C library's calls that change files, by LD_PRELOAD: counts them, logs them, and at a
 * chosen one kills the process or lets the call fail. Only files below one folder count, so that nothing else of the
 * program is touched. Armed from inside, through ctypes; one thread is assumed. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { COUNT, KILL, FAIL, FAIL_ON, SHORT };

static char root[PATH_MAX];
static size_t root_length;
static int mode, log_to = -1;
static long at, part, count;

/* Begin to watch `folder`, an absolute path, with the next call as number 0.
 * what: COUNT only counts; KILL kills before call number `number`, of a write after its first `extra` bytes; FAIL has
 * that call fail with errno `extra`; FAIL_ON has it and all later ones fail; SHORT has every write take `extra` bytes
 * at most. log: a descriptor for the log, or -1. */
void faults_arm(const char *folder, int what, long number, long extra, int log)
{
    snprintf(root, sizeof root, "%s", folder);
    root_length = strlen(root);
    mode = what;
    at = number;
    part = extra;
    log_to = log;
    count = 0;
}

long faults_count(void)
{
    return count;
}

static int watched(const char *path)
{
    if (root_length == 0)
        return 0;
    return path[0] != '/' ||
           (strncmp(path, root, root_length) == 0 && (path[root_length] == '/' || path[root_length] == 0));
}

static int watched_fd(int fd, char path[PATH_MAX])
{
    char link[64];
    ssize_t length;
    if (root_length == 0 || fd == log_to)
        return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    length = readlink(link, path, PATH_MAX - 1);
    if (length <= 0)
        return 0;
    path[length] = 0;
    if (strstr(path, " (deleted)"))
        return 0;
    return path[0] == '/' && watched(path);
}

static void put(const void *data, size_t size)
{
    while (size > 0) {
        ssize_t done = syscall(SYS_write, log_to, data, size);
        if (done <= 0)
            _exit(99);
        data = (const char *)data + done;
        size -= (size_t)done;
    }
}

static void note(const char *call, const char *path, const char *other, const void *data, size_t size)
{
    char line[2 * PATH_MAX + 100];
    if (log_to < 0)
        return;
    put(line, (size_t)snprintf(line, sizeof line, "%s\t%s\t%s\t%zu\n", call, path, other, data ? size : 0));
    if (data)
        put(data, size);
}

static void die(void)
{
    kill(getpid(), SIGKILL);
    for (;;)
        pause();
}

/* Counts a call other than a write. Returns whether it must fail, with errno set. */
static int hit(const char *call, const char *path, const char *other)
{
    long number = count++;
    if (mode == KILL && number == at)
        die();
    if ((mode == FAIL && number == at) || (mode == FAIL_ON && number >= at && strncmp(call, "unlink", 6) != 0)) {
        errno = (int)part;
        return 1;
    }
    note(call, path, other, NULL, 0);
    return 0;
}

#define REAL(result, name, ...)                                                                                        \
    static result (*real)(__VA_ARGS__);                                                                                \
    if (!real)                                                                                                         \
    real = (result (*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)

ssize_t write(int fd, const void *data, size_t size)
{
    char path[PATH_MAX];
    REAL(ssize_t, write, int, const void *, size_t);
    if (watched_fd(fd, path)) {
        long number = count++;
        if (mode == KILL && number == at) {
            if (part > 0)
                real(fd, data, (size_t)part < size ? (size_t)part : size);
            die();
        }
        if ((mode == FAIL && number == at) || (mode == FAIL_ON && number >= at)) {
            errno = (int)part;
            return -1;
        }
        if (mode == SHORT && size > (size_t)part)
            size = (size_t)part;
        note("write", path, "", data, size);
    }
    return real(fd, data, size);
}

/* A file without a name is of no interest. */
#define WRITES(flags) (((flags) & (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC)) != 0 && ((flags) & O_TMPFILE) != O_TMPFILE)
#define MODE_OF(flags, value)                                                                                          \
    if ((flags) & (O_CREAT | O_TMPFILE)) {                                                                             \
        va_list list;                                                                                                  \
        va_start(list, flags);                                                                                         \
        value = va_arg(list, mode_t);                                                                                  \
        va_end(list);                                                                                                  \
    }

static const char *open_kind(int flags)
{
    return flags & O_EXCL ? "create" : flags & O_TRUNC ? "truncate" : "open";
}

#define DEFINE_OPEN(name)                                                                                              \
    int name(const char *path, int flags, ...)                                                                         \
    {                                                                                                                  \
        mode_t value = 0;                                                                                              \
        REAL(int, name, const char *, int, ...);                                                                       \
        MODE_OF(flags, value)                                                                                          \
        if (WRITES(flags) && watched(path) && hit(open_kind(flags), path, ""))                                         \
            return -1;                                                                                                 \
        return real(path, flags, value);                                                                               \
    }
DEFINE_OPEN(open)
DEFINE_OPEN(open64)

#define DEFINE_OPENAT(name)                                                                                            \
    int name(int folder, const char *path, int flags, ...)                                                             \
    {                                                                                                                  \
        mode_t value = 0;                                                                                              \
        REAL(int, name, int, const char *, int, ...);                                                                  \
        MODE_OF(flags, value)                                                                                          \
        if (WRITES(flags) && watched(path) && hit(open_kind(flags), path, ""))                                         \
            return -1;                                                                                                 \
        return real(folder, path, flags, value);                                                                       \
    }
DEFINE_OPENAT(openat)
DEFINE_OPENAT(openat64)

#define DEFINE_FD(name)                                                                                                \
    int name(int fd)                                                                                                   \
    {                                                                                                                  \
        char path[PATH_MAX];                                                                                           \
        REAL(int, name, int);                                                                                          \
        if (watched_fd(fd, path) && hit("fsync", path, ""))                                                            \
            return -1;                                                                                                 \
        return real(fd);                                                                                               \
    }
DEFINE_FD(fsync)
DEFINE_FD(fdatasync)

#define DEFINE_PATH(name)                                                                                              \
    int name(const char *path)                                                                                         \
    {                                                                                                                  \
        REAL(int, name, const char *);                                                                                 \
        if (watched(path) && hit(#name, path, ""))                                                                     \
            return -1;                                                                                                 \
        return real(path);                                                                                             \
    }
DEFINE_PATH(unlink)
DEFINE_PATH(rmdir)

#define DEFINE_TWO(name)                                                                                               \
    int name(const char *path, const char *other)                                                                      \
    {                                                                                                                  \
        REAL(int, name, const char *, const char *);                                                                   \
        if (watched(other) && hit(#name, path, other))                                                                 \
            return -1;                                                                                                 \
        return real(path, other);                                                                                      \
    }
DEFINE_TWO(rename)
DEFINE_TWO(link)

int mkdir(const char *path, mode_t value)
{
    REAL(int, mkdir, const char *, mode_t);
    if (watched(path) && hit("mkdir", path, ""))
        return -1;
    return real(path, value);
}

int unlinkat(int folder, const char *path, int flags)
{
    REAL(int, unlinkat, int, const char *, int);
    if (watched(path) && hit("unlink", path, ""))
        return -1;
    return real(folder, path, flags);
}

int mkdirat(int folder, const char *path, mode_t value)
{
    REAL(int, mkdirat, int, const char *, mode_t);
    if (watched(path) && hit("mkdir", path, ""))
        return -1;
    return real(folder, path, value);
}

int renameat(int from, const char *path, int to, const char *other)
{
    REAL(int, renameat, int, const char *, int, const char *);
    if (watched(other) && hit("rename", path, other))
        return -1;
    return real(from, path, to, other);
}

int linkat(int from, const char *path, int to, const char *other, int flags)
{
    REAL(int, linkat, int, const char *, int, const char *, int);
    if (watched(other) && hit("link", path, other))
        return -1;
    return real(from, path, to, other, flags);
}

int fchmod(int fd, mode_t value)
{
    char path[PATH_MAX];
    REAL(int, fchmod, int, mode_t);
    if (watched_fd(fd, path) && hit("fchmod", path, ""))
        return -1;
    return real(fd, value);
}
