# Debian systems in folders, for the scripts here. Needs root and debootstrap.

# make_system FOLDER SUITE [OPTION...]: make a system with this system's network and certificates
make_system() {
    local folder=$1 suite=$2
    shift 2
    debootstrap --variant=minbase "$@" "$suite" "$folder" >/dev/null
    cp /etc/resolv.conf "$folder/etc/"
    mkdir -p "$folder/etc/ssl/certs"
    cp /etc/ssl/certs/ca-certificates.crt "$folder/etc/ssl/certs/"
    # a mirror may lag behind
    echo 'Acquire::Check-Valid-Until "false";' >"$folder/etc/apt/apt.conf.d/99lag"
    mount -t proc proc "$folder/proc"
    trap "umount $(printf %q "$folder")/proc; $(trap -p EXIT | sed "s/^trap -- '\(.*\)' EXIT$/\1/")" EXIT
}

# run_inside FOLDER COMMAND...: run a command there, without this user's settings
run_inside() {
    local folder=$1
    shift
    chroot "$folder" env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive \
        PIP_CERT=/etc/ssl/certs/ca-certificates.crt SSL_CERT_FILE=/etc/ssl/certs/ca-certificates.crt "$@"
}
