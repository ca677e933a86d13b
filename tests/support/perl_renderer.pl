#!/usr/bin/perl
# A renderer in Perl. Its argument says how it behaves: honestly, or with one fault.
use strict;
use warnings;
use Compress::Zlib qw(compress crc32);
use JSON::PP;

my $mode = shift // 'npy';
my $json = JSON::PP->new->canonical;
my $camera;
$| = 1;

sub chunk { my ($kind, $data) = @_; pack('N', length $data) . $kind . $data . pack('N', crc32($kind . $data)) }

sub png {
    my ($width, $height, $bits, $colour, $rows) = @_;
    return "\x89PNG\r\n\x1a\n" . chunk('IHDR', pack('NNCCCCC', $width, $height, $bits, $colour, 0, 0, 0))
        . chunk('IDAT', compress(join '', map { "\0$_" } @$rows)) . chunk('IEND', '');
}

sub npy {
    my ($type, $width, $height, $data) = @_;
    my $header = "{'descr': '$type', 'fortran_order': False, 'shape': ($height, $width), }";
    $header .= ' ' x (63 - (10 + length $header) % 64) . "\n";
    return "\x93NUMPY\x01\x00" . pack('v', length $header) . $header . $data;
}

sub save { my ($name, $data) = @_; open my $file, '>:raw', "$camera->{folder}/$name" or die $!; print $file $data; close $file }

# Whether a fault occurs for the first time; a file beside the folder remembers it.
sub once { my $mark = "$camera->{folder}/../$mode.mark"; return 0 if -e $mark; open my $file, '>', $mark; close $file; return 1 }

while (my $line = <STDIN>) {
    my $message = $json->decode($line);
    last if $message->{bye};
    if ($camera = $message->{hello} // $camera and $message->{hello}) {
        if ($mode eq 'garbage-first') { print "starting ...\n"; next }
        my @parameters = ({ name => 'lamp', default => 1, minimum => 0.2, maximum => 2, unit => '1' });
        print $json->encode({ ready => { name => 'perl', version => '3', parameters => \@parameters,
            depth => $mode eq 'rgb' ? JSON::PP::false : JSON::PP::true } }), "\n";
        next;
    }
    my $render = $message->{render};
    my ($id, $w, $h) = ($render->{id}, $camera->{width}, $camera->{height});
    if ($mode eq 'dies' or $mode eq 'dies-once' && $id == 1 && once()) { print STDERR "out of memory\n"; exit 9 }
    if ($mode eq 'hangs' or $mode eq 'hangs-once' && $id == 1 && once()) { sleep 100 }
    if ($mode eq 'dies-at-1' and $id == 1) { kill 'KILL', $$ }
    if ($mode eq 'garbage') { print "rendering $id\n"; next }
    if ($mode eq 'endless') { print 'x' x 2_000_000; next }
    if ($mode eq 'fails-at-1' and $id == 1) { print $json->encode({ failed => { id => 1, reason => 'inside a wall' } }), "\n"; next }
    my $width = $mode eq 'wide' ? $w + 1 : $w;
    my @rgb = map { my $y = $_; join '', map { pack 'CCC', $_ % 256, $y % 256, 255 * $render->{parameters}{lamp} / 2 } 0 .. $width - 1 } 0 .. $h - 1;
    my @metres = map { abs($render->{x}) + $_ / 16 } 0 .. $w * $h - 1;
    $metres[3] = 9 ** 9 ** 9 if $mode eq 'infinite';
    my $name = $mode eq 'outside' ? "../../$render->{rgb}" : $render->{rgb};
    if ($mode eq 'link') { symlink '/etc/passwd', "$camera->{folder}/$name" }
    elsif ($mode ne 'missing') { save($name, png($width, $h, 8, 2, \@rgb)) }
    if ($mode eq 'png') {
        my @rows = map { my $y = $_; pack 'n*', map { 1000 * $metres[$y * $w + $_] + 0.5 } 0 .. $w - 1 } 0 .. $h - 1;
        save($render->{depth}, png($w, $h, 16, 0, \@rows));
    }
    elsif ($mode eq 'double') { save($render->{depth}, npy('<f8', $w, $h, pack 'd<*', @metres)) }
    elsif ($mode ne 'rgb') { save($render->{depth}, npy('<f4', $w, $h, pack 'f<*', @metres)) }
    my %rendered = (id => $mode eq 'wrong-id' ? $id + 1 : $id);
    $rendered{rgb} = '/etc/passwd' if $mode eq 'path';
    print $json->encode({ rendered => \%rendered }), "\n";
}
